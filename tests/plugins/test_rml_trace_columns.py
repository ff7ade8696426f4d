"""Traces whose lines are alike: read in columns they come out as read value after value."""

from __future__ import annotations

import json
from io import BytesIO

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ariac_score_rml import Run, compile_rml, run_trace
from ariac_score_rml.trace_columns import run_lines
from ariac_score_rml.traces import read_events

SPEC = """
low matches {topic: 's', x: v} with v <= 1;
one matches {x: 1};
float_one matches {x: 1.0};
zero matches {x: 0.0};
flag matches {on: true};
nested matches {at: {x: v, name: 'a'}} with v > 0.5;
same matches {x: v, y: v};
whole matches {list: [...]};
Main = (low \\/ one \\/ float_one zero* \\/ flag \\/ nested \\/ same)*;
"""


def both(text: str, spec: str = SPEC) -> tuple[Run | None, Run]:
    program = compile_rml(spec)
    return run_lines(program.machine(), BytesIO(text.encode())), run_trace(
        program.machine(), read_events(text)
    )


numbers = st.sampled_from(
    ["0", "1", "-1", "0.0", "-0.0", "1.0", "0.5", "1e0", "2.25", "-0", "1E-1", "12345678901"]
)
lines = (
    st.builds('{{"topic": "s", "x": {}, "y": {}}}'.format, numbers, numbers)
    | st.builds('{{"x":{}}}'.format, numbers)
    | st.builds('{{"on": {}, "x": {}}}'.format, st.sampled_from(["true", "false", "null"]), numbers)
    | st.builds('{{"at": {{"x": {}, "name": "{}"}}}}'.format, numbers, st.sampled_from("ab"))
    | st.builds('{{"topic": "1 \\" {{}} ü", "x": {}}}'.format, numbers)
)


@pytest.mark.slow
@given(st.lists(lines, max_size=30), st.sampled_from(["\n", "\r\n", "\n\n"]))
@settings(max_examples=200)
def test_columns_say_what_the_events_say(trace: list[str], end: str) -> None:
    text = "".join(line + end for line in trace)

    fast, slow = both(text)

    assert fast in (None, slow)


@given(st.lists(st.sampled_from(["0.5", "1.0", "1.5", "0.25"]), min_size=1, max_size=40))
@settings(max_examples=50)
def test_lines_of_one_layout_are_read_in_columns(values: list[str]) -> None:
    text = "".join(f'{{"topic": "s", "x": {value}}}\n' for value in values)

    fast, slow = both(text, "low matches {topic: 's', x: v} with v <= 1; Main = low*;")

    assert fast == slow


def test_what_is_in_a_line_besides_keeps_nothing_from_columns(subtests: pytest.Subtests) -> None:
    cases: list[str] = [
        '{"topic": "ns::s", "x": 0.5}',
        '{"a:b": {"c": "d:e"}, "x": 0.5}',
        '{"covariance": [1, 2.0, null], "x": 0.5}',
        '{"x": 0.5} {"x": 0.25}',  # two events on a line
        '{"stamp": 9007199254740991, "x": 0.5}',
    ]
    for line in cases:
        with subtests.test(line=line):
            fast, slow = both(f"{line}\n" * 3, "low matches {x: v} with v <= 1; Main = low*;")

            assert fast == slow


@pytest.mark.parametrize("block_bytes", [1, 10, 29, 100, 1000])
def test_blocks_join_without_a_seam(monkeypatch: pytest.MonkeyPatch, block_bytes: int) -> None:
    text = "".join(f'{{"topic": "{"s" if i % 3 else "t"}", "x": {i / 64}}}\n' for i in range(60)).rstrip()
    expected = both(text)
    monkeypatch.setattr("ariac_score_rml.trace_columns._BLOCK_BYTES", block_bytes)

    assert expected[0] is not None
    assert both(text) == expected


def test_what_is_not_plain_is_left_to_the_interpreter(subtests: pytest.Subtests) -> None:
    cases: list[str] = [
        '{"x": 1.0,}\n',
        '{"x": 1.0, "x": 2.0}\n',
        '{"x": 1.0, "at": {"n": 2.0, "n": 2.0}}\n',
        '{"s": "a\\u003ab", "x": 1.0, "x": 2.0}\n',  # the text has as many colons as keys and strings
        '{"s": "a\\u003Ab", "x": 1.0, "x": 2.0}\n',
        '{"list": [{"x": 1.0, "x": 2.0}]}\n',
        '{"x": 1.0}\n{"x": 1.\n',
        '{"x": NaN}\n',
        '{"x": 9007199254740993}\n',
        '{"x": 1e999}\n',
        "[1.0]\n",
        "1.0\n",
        '{"x": 01}\n',
        "".join(f'{{"name": "{i}"}}\n' for i in range(30)),  # nothing alike
        '{"topic": "s", "x": "1"}\n',  # an error names its event
        '{"topic": "s", "x": 1.00000000001}\n',  # a verdict that hangs on the tolerance is counted
        "[" * 5_000,
    ]
    for text in cases:
        with subtests.test(text=text):
            spec = "low matches {topic: 's', x: v} with v <= 1; Main = low*;"

            assert run_lines(compile_rml(spec).machine(), BytesIO(text.encode())) is None


def test_text_that_is_no_utf_8_is_not_read_in_columns() -> None:
    assert run_lines(compile_rml("Main = any*;").machine(), BytesIO(b'{"x": "\xff"}\n')) is None


def test_an_empty_trace_has_the_initial_letter_alone() -> None:
    fast, slow = both("")

    assert fast == slow
    assert slow.letters == ""


def test_a_rejection_ends_the_letters() -> None:
    text = "".join(json.dumps({"x": x}) + "\n" for x in (0.5, 0.75, 2.0, 0.5))

    fast, _ = both(text, "low matches {x: v} with v <= 1; Main = low*;")

    assert fast is not None
    assert fast.letters == "ttF"
