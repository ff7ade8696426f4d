"""One trial in every format and compression: `score` gives the same result, to the byte."""

from __future__ import annotations

import base64
import bz2
import json
import sqlite3
import zlib
from collections.abc import Callable
from contextlib import closing, redirect_stdout
from dataclasses import replace
from functools import partial
from io import StringIO
from itertools import pairwise
from pathlib import Path

import cramjam
import pytest

from ariac_score.cli import main
from ariac_score.testing import Recorded, write_bag
from ariac_score.testing.repacked import McapForm, repacked
from ariac_score_ariac.testing import kitting_trial
from ariac_score_ariac.testing.recordings import recorded_messages

MESSAGES = recorded_messages(kitting_trial(duration_s=33.0))
NARROW = "distance_robot_human_operator"
Write = Callable[[Path, list[Recorded]], Path]


def ros1(folder: Path, messages: list[Recorded], compression: str) -> Path:
    return write_bag(folder / "trial.bag", messages, storage="ros1", compression=compression)


def mcap(folder: Path, messages: list[Recorded], form: McapForm) -> Path:
    path = write_bag(folder / "trial.mcap", messages, storage="mcap")
    path.write_bytes(repacked(path.read_bytes(), form))
    return path


def sqlite(folder: Path, messages: list[Recorded]) -> Path:
    return write_bag(folder / "trial.db3", messages, storage="sqlite3")


def sqlite_folder(folder: Path, messages: list[Recorded]) -> Path:
    return write_bag(folder / "trial", messages, storage="sqlite3")


def split(folder: Path, messages: list[Recorded], write: Write) -> Path:
    """Three files of one recording, of which each declares anew what it holds."""
    bounds, parts = (0, len(messages) // 4, len(messages) // 2, len(messages)), []
    (folder / "trial").mkdir()
    for number, (first, last) in enumerate(pairwise(bounds)):
        part = write(folder, messages[first:last])
        parts.append(part.rename(folder / f"trial/trial_{number}{part.suffix}"))
    return described(folder / "trial", parts, len(messages))


def described(folder: Path, files: list[Path], count: int, *, mode: str = "") -> Path:
    """`metadata.yaml` as rosbag2 writes it, as far as it says anything about the files."""
    storage = "sqlite3" if ".db3" in files[0].name else "mcap"
    names = "".join(f"    - {file.name}\n" for file in files)
    (folder / "metadata.yaml").write_text(
        f"rosbag2_bagfile_information:\n  version: 5\n  storage_identifier: {storage}\n"
        f"  relative_file_paths:\n{names}  message_count: {count}\n"
        f"  compression_format: {mode and 'zstd'!r}\n  compression_mode: {mode!r}\n",
        encoding="utf-8",
    )
    return folder


def packed_files(folder: Path, messages: list[Recorded], write: Write) -> Path:
    """Files that are compressed as a whole."""
    bag = split(folder, messages, write)
    parts = []
    for file in sorted(bag.glob("trial_*")):
        parts.append(file.with_name(f"{file.name}.zstd"))
        parts[-1].write_bytes(bytes(cramjam.zstd.compress(file.read_bytes())))
        file.unlink()
    return described(bag, parts, len(messages), mode="FILE")


def packed_messages(folder: Path, messages: list[Recorded]) -> Path:
    """Payloads of which each is compressed on its own."""
    (folder / "trial").mkdir()
    path = sqlite(folder, messages).rename(folder / "trial/trial.db3")
    with closing(sqlite3.connect(path)) as bag:
        rows = bag.execute("SELECT id, data FROM messages").fetchall()
        packed = [(bytes(cramjam.zstd.compress(payload)), number) for number, payload in rows]
        bag.executemany("UPDATE messages SET data = ? WHERE id = ?", packed)
        bag.commit()
    return described(folder / "trial", [path], len(messages), mode="MESSAGE")


PLAIN = McapForm()
WAYS: dict[str, Write] = {
    "mcap": partial(mcap, form=PLAIN),
    "mcap of lz4": partial(mcap, form=McapForm("lz4")),
    "mcap of zstd": partial(mcap, form=McapForm("zstd")),
    "mcap in small chunks": partial(mcap, form=replace(PLAIN, chunk_bytes=1)),
    "mcap in small chunks of lz4": partial(mcap, form=McapForm("lz4", chunk_bytes=1 << 10)),
    "mcap in one chunk of zstd": partial(mcap, form=McapForm("zstd", chunk_bytes=1 << 30)),
    "mcap without chunks": partial(mcap, form=replace(PLAIN, chunk_bytes=0)),
    "mcap without chunks and summary": partial(mcap, form=McapForm(chunk_bytes=0, indexed=False)),
    "mcap without indexes": partial(mcap, form=McapForm(indexed=False)),
    "mcap of lz4 without indexes": partial(mcap, form=McapForm("lz4", indexed=False)),
    "mcap of zstd without indexes": partial(mcap, form=McapForm("zstd", indexed=False)),
    "mcap without checksums": partial(mcap, form=McapForm(chunk_checksums=False)),
    "mcap of lz4 with a checksum as a whole": partial(mcap, form=McapForm("lz4", data_checksum=True)),
    "three files of mcap": partial(split, write=partial(mcap, form=McapForm("lz4"))),
    "three packed files of mcap": partial(packed_files, write=partial(mcap, form=PLAIN)),
    "ros 1": partial(ros1, compression=""),
    "ros 1 of lz4": partial(ros1, compression="lz4"),
    "ros 1 of bz2": partial(ros1, compression="bz2"),
    "sqlite": sqlite,
    "sqlite in a folder": sqlite_folder,
    "sqlite, packed messages": packed_messages,
    "three files of sqlite": partial(split, write=sqlite),
    "three packed files of sqlite": partial(packed_files, write=sqlite),
}


def scored(path: Path, *more: str, rules: str = "paper2020.published") -> tuple[int, str]:
    """Exit code and result, without the names, lengths and hashes of what was read."""
    with redirect_stdout(StringIO()) as told:
        code = main(["score", str(path), "--rules", rules, "--output-format", "json", *more])
    said = json.loads(told.getvalue())
    assert {given["role"] for given in said["provenance"]["inputs"]} == {"log"}
    del said["provenance"]["inputs"], said["measured"]["statements"]  # both name the files
    return code, json.dumps(said)


@pytest.fixture(scope="module")
def expected(tmp_path_factory: pytest.TempPathFactory) -> tuple[int, str]:
    return scored(write_bag(tmp_path_factory.mktemp("e") / "trial.mcap", MESSAGES, storage="mcap"))


@pytest.mark.parametrize("jobs", ["1", "2"])
@pytest.mark.parametrize("way", WAYS)
def test_a_trial_scores_the_same_in_every_format(
    way: str, jobs: str, expected: tuple[int, str], tmp_path: Path
) -> None:
    assert scored(WAYS[way](tmp_path, MESSAGES), "--jobs", jobs) == expected
    assert expected[0] == 0


@pytest.mark.parametrize("way", ["mcap of lz4", "ros 1 of bz2", "sqlite, packed messages"])
@pytest.mark.parametrize(
    "change",
    [
        pytest.param(lambda m: replace(m, t_ns=m.t_ns + 1), id="a stamp by 1 ns"),
        pytest.param(
            lambda m: replace(m, fields={**m.fields, NARROW: m.fields[NARROW] * (1 + 1e-11)}), id="a distance"
        ),
    ],
)
def test_one_number_changed_is_another_result(
    change: Callable[[Recorded], Recorded], way: str, expected: tuple[int, str], tmp_path: Path
) -> None:
    closest = min(
        (i for i, m in enumerate(MESSAGES) if NARROW in m.fields), key=lambda i: MESSAGES[i].fields[NARROW]
    )
    changed = [*MESSAGES[:closest], change(MESSAGES[closest]), *MESSAGES[closest + 1 :]]

    assert scored(WAYS[way](tmp_path, changed)) != expected


def test_a_compression_that_nobody_knows_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="no compression 'lzma'"):
        mcap(tmp_path, MESSAGES, McapForm("lzma"))


# Gazebo's state.log -------------------------------------------------------------------

RULES = """
id: contact
title: contact with the human, in a state.log
source: made
log_map: ./map.yaml
window: recording
monitors:
  contact:
    use: ariac.human_contact
    with: {distance: centre_distance, contact_distance_m: 0.5, max_gap_s: 0.15}
parameters: {points: 1}
score: points - violated(contact)
"""
LOG_MAP = """
id: two_models
title: an arm and a human
source: made
bodies: {human: {kind: human}, robot: {kind: robot}}
models:
  - {match: person_1, kind: human, body: human}
  - {match: gantry, kind: robot, body: robot}
"""
ENCODINGS: dict[str, Callable[[str], str]] = {
    "txt": str,
    "zlib": lambda text: base64.b64encode(zlib.compress(text.encode())).decode(),
    "bz2": lambda text: base64.b64encode(bz2.compress(text.encode())).decode(),
}


def state_log(folder: Path, encodings: list[str], *, closest: str = "0.4") -> Path:
    """A human who comes near a gantry; its frames in as many chunks as there are encodings."""
    frames = [
        f"<sdf version='1.6'><state world_name='w'><sim_time>{k // 10} {k % 10}00000000</sim_time>"
        f"<model name='gantry'><pose>{k / 100} 0 0 0 0 0</pose></model>"
        f"<model name='person_1'><pose>{k / 100} {closest if k == 77 else 0.9} 0 0 0 0</pose></model>"
        "</state></sdf>"
        for k in range(120)
    ]
    each, chunks = (
        -(-len(frames) // len(encodings)),
        [("txt", "<sdf version ='1.6'><world name='w'></world></sdf>")],
    )
    chunks += [(e, "".join(frames[i * each : (i + 1) * each])) for i, e in enumerate(encodings)]
    (folder / "state.log").write_text(
        "<?xml version='1.0'?>\n<gazebo_log>\n<header>\n<log_version>1.0</log_version>\n</header>\n"
        + "".join(
            f"<chunk encoding='{e}'>\n<![CDATA[{ENCODINGS[e](text)}]]>\n</chunk>\n" for e, text in chunks
        )
        + "</gazebo_log>\n",
        encoding="utf-8",
    )
    (folder / "rules.yaml").write_text(RULES, encoding="utf-8")
    (folder / "map.yaml").write_text(LOG_MAP, encoding="utf-8")
    return folder / "state.log"


@pytest.mark.parametrize(
    "encodings", [["zlib"], ["bz2"], ["zlib"] * 7, ["bz2"] * 120, ["txt", "zlib", "bz2", "zlib"]], ids=str
)
def test_a_state_log_scores_the_same_however_its_chunks_are_encoded(
    encodings: list[str], tmp_path: Path
) -> None:
    rules = str(tmp_path / "rules.yaml")
    code, plain = scored(state_log(tmp_path, ["txt"]), rules=rules)
    result = json.loads(plain)

    assert (code, result["score"], result["measured"]["findings"]["contact#1"]["verdict"]) == (
        0,
        0,
        "violated",
    )
    assert scored(state_log(tmp_path, encodings), "--jobs", "2", rules=rules) == (code, plain)
    assert scored(state_log(tmp_path, encodings, closest="0.4000001"), rules=rules) != (code, plain)
