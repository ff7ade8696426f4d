"""`batch.json` is written and read through one class, and keeps the bytes that earlier versions wrote."""

from __future__ import annotations

import json
from pathlib import Path

import msgspec
import pytest

from ariac_score.batch.description import BatchDescription, Shard, load_description, refuse_other_version
from ariac_score.errors import UsageError
from ariac_score.results.result import Code, Pinned

BEFORE = Path(__file__).parents[1] / "data/before/batch/batch.json"
SHA256 = "0f" * 32
PART = BatchDescription(
    "season",
    Pinned("ariac2024.official", SHA256),
    (Code("ariac-score", "0.1.0", "ariac_score", SHA256),),
    "parts",
    Shard(2, 8),
)
AS_JSON = f"""\
{{
 "batch": "season",
 "code": [
  {{
   "distribution": "ariac-score",
   "package": "ariac_score",
   "sha256": "{SHA256}",
   "version": "0.1.0"
  }}
 ],
 "read": "parts",
 "rule_set": {{
  "id": "ariac2024.official",
  "sha256": "{SHA256}"
 }},
 "schema": "ariac-score/batch/1",
 "shard": {{
  "number": 2,
  "of": 8
 }}
}}
"""


def described(folder: Path, text: str) -> Path:
    (folder / "batch.json").write_text(text, encoding="utf-8")
    return folder


def test_a_description_has_these_bytes() -> None:
    assert PART.text() == AS_JSON


def test_what_is_written_is_read(tmp_path: Path) -> None:
    assert load_description(described(tmp_path, AS_JSON), hint="") == PART


def test_a_description_of_the_version_before_is_written_again_byte_for_byte() -> None:
    assert load_description(BEFORE.parent, hint="").text() == BEFORE.read_text(encoding="utf-8")


def test_a_folder_whose_name_is_no_utf8_is_described(tmp_path: Path) -> None:
    strange = msgspec.structs.replace(PART, batch="caf\udce9")
    assert load_description(described(tmp_path, strange.text()), hint="") == strange


def test_a_folder_without_a_description_is_no_batch(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="this is no folder of a batch") as refused:
        load_description(tmp_path, hint="score them first")
    assert refused.value.hint == "score them first"


@pytest.mark.parametrize(
    ("change", "cause"),
    [
        ({"batch": 7}, r"Expected `str`, got `int` - at `\$.batch`"),
        ({"rule_set": {"id": "x"}}, r"missing required field `sha256` - at `\$.rule_set`"),
        ({"shard": {"number": 1, "of": 2, "at": 3}}, "unknown field `at`"),
        ({"shards": 3}, "unknown field `shards`"),
    ],
)
def test_a_description_that_was_edited_is_refused_with_the_place(
    tmp_path: Path, change: dict[str, object], cause: str
) -> None:
    folder = described(tmp_path, json.dumps({**json.loads(AS_JSON), **change}))
    with pytest.raises(UsageError, match=cause) as refused:
        load_description(folder, hint="")
    assert "it writes it anew" in refused.value.hint


@pytest.mark.parametrize("content", [b"", b"{", b"\xff\xfe", b"[1]", b"[" * 100_000])
def test_a_damaged_description_is_refused_where_it_is_needed_and_else_written_anew(
    tmp_path: Path, content: bytes
) -> None:
    (tmp_path / "batch.json").write_bytes(content)
    refuse_other_version(tmp_path)
    with pytest.raises(UsageError, match="it is damaged"):
        load_description(tmp_path, hint="")


def test_another_version_is_refused_by_both(tmp_path: Path) -> None:
    described(tmp_path, AS_JSON.replace("batch/1", "batch/2"))
    cause = "made as ariac-score/batch/2, and this version reads ariac-score/batch/1"
    with pytest.raises(UsageError, match=cause):
        refuse_other_version(tmp_path)
    with pytest.raises(UsageError, match=cause):
        load_description(tmp_path, hint="")
