"""What a YAML file looks like, named without quoting it; official files: `test_official_configs.py`."""

from __future__ import annotations

from pathlib import Path
from typing import NoReturn

import pytest

from ariac_score_ariac.config.config_forms import form_in, form_of, looks_like, top_level_keys

ORDER = "orders: {order_0: "


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "an empty file"),
        ("# nothing\n", "an empty file"),
        ("- a\n- b\n", "a YAML file without keys"),
        ("just words", "a YAML file without keys"),
        ("{broken", "no YAML file that can be read"),
        (ORDER + "{kit_count: 1}}", "a trial configuration of 2017"),
        (ORDER + "{parts: {}}}", "a trial configuration of 2017"),
        (ORDER + "{products: {}}}", "a trial configuration of 2018 to 2020"),
        (ORDER + "{products: {}, destinations: [agv1]}}", "a trial configuration of 2019 or 2020"),
        (ORDER + "{kitting: {}}}", "a trial configuration of 2021 or 2022"),
        (ORDER + "{kitting: {trays: []}}}", "a trial configuration of 2022"),
        ("orders: []", "a trial configuration of 2023 or 2024"),
        ("orders: 3", "a trial configuration of 2018 to 2020"),
        ("NUM_KITS: 1\nSEED: 2", "a trial configuration of 2025"),
        ("kitting_trays: {}", "a trial configuration without orders"),
        ("sensors: {a: {type: rgb_camera}}", "a team configuration of 2023"),
        ("sensors: {a: {type: [1]}}", "a team configuration of 2017 to 2023"),
        ("sensors: [1]", "a team configuration of 2017 to 2023"),
        ("gantry_tray_camera: {}", "a team configuration of 2022"),
        ("static_sensors: {}", "a team configuration of 2024"),
        ("SENSORS: []", "a team configuration of 2025"),
        ("team_name: a", "a team's entry for the evaluation of 2023 or 2024"),
        ("node: {ros__parameters: {}}", "parameters of ROS nodes"),
        ("score: a\nrules: {}", "a rule set"),
        ("b: secret\na: 1", "a YAML file with the keys a, b"),
        ("a: 1\nb: 1\nc: 1\nd: 1\ne: 1\nf: 1", "a YAML file with the keys a, b, c, d, e, …"),
    ],
)
def test_a_file_is_called_by_what_it_looks_like(tmp_path: Path, text: str, words: str) -> None:
    path = tmp_path / "a.yaml"
    path.write_text(text, encoding="utf-8")

    assert looks_like(path) == words


@pytest.mark.parametrize(
    ("text", "years"),
    [
        (ORDER + "{products: {}}}", (2018, 2019, 2020)),
        (ORDER + "{kitting: {}}}", (2021, 2022)),
        ("NUM_KITS: 1\nSEED: 2", (2025,)),
        ("sensors: [1]", (2017, 2018, 2019, 2020, 2021, 2022, 2023)),
        ("kitting_trays: {}", ()),
        ("since_2019: 1\nuntil_2031: 2", ()),  # years in the names of keys are no editions
    ],
)
def test_the_years_of_a_form_are_numbers(tmp_path: Path, text: str, years: tuple[int, ...]) -> None:
    path = tmp_path / "a.yaml"
    path.write_text(text, encoding="utf-8")

    assert form_in(path).years == years


def test_a_form_is_known_by_the_keys_of_a_document() -> None:
    assert form_of({"SENSORS": [], "COMPETITOR_NAME": "secret"}).years == (2025,)


def test_what_is_not_there_looks_like_nothing(tmp_path: Path) -> None:
    assert looks_like(tmp_path / "none.yaml") == "no YAML file that can be read"
    assert top_level_keys(tmp_path / "none.yaml") == frozenset()


def test_a_file_that_cannot_be_opened_has_no_keys(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "a.yaml"
    path.write_text("orders: {}\n", encoding="utf-8")
    assert top_level_keys(path) == {"orders"}

    def refused(*_: object, **__: object) -> NoReturn:
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(Path, "open", refused)

    assert top_level_keys(path) == frozenset()


def test_keys_are_those_that_begin_a_line(tmp_path: Path) -> None:
    path = tmp_path / "a.yaml"
    path.write_text("\ufefforders: {}\n'a' : 1\n  b: 2\n# c: 3\n- d: 4\n", encoding="utf-8")

    assert top_level_keys(path) == {"orders", "a"}
