"""Who may ask a server of ours, request by request. Expected answers from RFC 6454 (Origin), RFC 9110 (Host)
and RFC 6750 (Bearer)."""

from __future__ import annotations

import os
import socket
from pathlib import Path

import pytest

from ariac_score.errors import UsageError
from ariac_score.serving.guard import Guard, is_loopback, listening, names_beyond, read_token

TOKEN = "x7Kq2mN9pL4wRt8v"  # noqa: S105  # of no server
ANY = "0.0.0.0"  # noqa: S104  # what is refused


def status(*headers: tuple[str, str], target: str = "/", guard: Guard | None = None) -> int:
    refusal = (guard or Guard()).refusal(target, headers)
    return refusal.status if refusal else 200


@pytest.mark.parametrize(
    "host",
    ["127.0.0.1:8080", "localhost", "LOCALHOST:8080", "localhost.:80", "[::1]:8080", "192.168.1.20:8080"],
)
def test_a_program_that_calls_the_server_by_an_address_or_as_localhost_may_ask(host: str) -> None:
    assert status(("Host", host)) == 200
    assert status(("host", host), ("Origin", f"http://{host}")) == 200


@pytest.mark.parametrize(
    "host",
    ["evil.example", "evil.example:8080", "127.0.0.1.evil.example", "localhost.evil.example", "2130706433"],
)
def test_a_name_that_leads_here_is_no_name_of_ours(host: str) -> None:
    assert status(("Host", host)) == 403
    assert status(("Host", host), ("Origin", f"http://{host}")) == 403


@pytest.mark.parametrize(
    "origin",
    [
        "https://evil.example",
        "null",
        "",
        "http://127.0.0.1:8081",  # another server of this machine
        "http://localhost:8080",  # for a browser, another origin than 127.0.0.1
        "http://127.0.0.1:8080.evil.example",
        "http://127.0.0.1:8080@evil.example",
        "file://",
        "chrome-extension://abcdef",
    ],
)
def test_a_page_of_somebody_else_may_not_ask(origin: str) -> None:
    assert status(("Host", "127.0.0.1:8080"), ("Origin", origin)) == 403


def test_ports_that_go_without_saying_are_the_same() -> None:
    assert status(("Host", "127.0.0.1"), ("Origin", "http://127.0.0.1:80")) == 200
    assert status(("Host", "127.0.0.1:443"), ("Origin", "https://127.0.0.1")) == 200
    assert status(("Host", "127.0.0.1"), ("Origin", "http://127.0.0.1:443")) == 403


@pytest.mark.parametrize(
    "headers",
    [
        (),
        (("Host", ""),),
        (("Host", "127.0.0.1"), ("Host", "127.0.0.1")),
        (("Host", "127.0.0.1"), ("host", "evil.example")),
        (("Host", "127.0.0.1 evil.example"),),
        (("Host", "user@127.0.0.1"),),
        (("Host", "127.0.0.1:"),),
        (("Host", "127.0.0.1"), ("Origin", "http://127.0.0.1"), ("Origin", "https://evil.example")),
    ],
)
def test_a_header_of_no_or_two_meanings_is_refused(headers: tuple[tuple[str, str], ...]) -> None:
    assert status(*headers) == 400


def test_a_server_may_have_names_of_its_own() -> None:
    cell = Guard(names=frozenset({"cell1"}))

    assert status(("Host", "Cell1:8000"), guard=cell) == 200
    assert status(("Host", "cell2:8000"), guard=cell) == 403


@pytest.mark.parametrize(
    ("target", "headers"),
    [
        ("/", (("Authorization", f"Bearer {TOKEN}"),)),
        ("/", (("authorization", f"bearer  {TOKEN}"),)),
        (f"/?token={TOKEN}", ()),
        (f"/events?cell=1&token={TOKEN}", ()),
        ("/", (("Cookie", f"other=1; ariac_score_8000={TOKEN}"),)),
    ],
)
def test_a_token_may_come_in_three_ways(target: str, headers: tuple[tuple[str, str], ...]) -> None:
    assert status(("Host", "10.0.0.1"), *headers, target=target, guard=Guard(TOKEN)) == 200


@pytest.mark.parametrize(
    ("target", "headers"),
    [
        ("/", ()),
        ("/", (("Authorization", f"Basic {TOKEN}"),)),
        ("/", (("Authorization", f"Bearer {TOKEN}x"),)),
        ("/", (("Authorization", "Bearer "),)),
        ("/", (("Authorization", "Bearer \udcff"),)),
        (f"/?token={TOKEN[:-1]}", ()),
        (f"/?{'a=1&' * 30}token={TOKEN}", ()),  # of more fields than anybody needs
        ("//[", ()),
        ("/", (("Cookie", f"session={TOKEN}"),)),
    ],
)
def test_without_the_token_nobody_is_answered(target: str, headers: tuple[tuple[str, str], ...]) -> None:
    assert status(("Host", "10.0.0.1"), *headers, target=target, guard=Guard(TOKEN)) == 401


def test_a_page_with_the_token_brings_it_as_a_cookie_from_then_on() -> None:
    guard = Guard(TOKEN)
    pair, *attributes = guard.cookie(8000).split("; ")

    assert status(("Host", "10.0.0.1"), ("Cookie", pair), guard=guard) == 200
    assert {"HttpOnly", "SameSite=Strict"} <= set(attributes)


def test_a_page_of_somebody_else_is_refused_even_with_the_token() -> None:
    headers = (("Host", "10.0.0.1"), ("Origin", "https://evil.example"), ("Authorization", f"Bearer {TOKEN}"))

    assert status(*headers, guard=Guard(TOKEN)) == 403


@pytest.mark.parametrize("address", ["127.0.0.1", "127.9.9.9", "::1", "::ffff:127.0.0.1"])
def test_this_machine_alone_reaches_loopback(address: str) -> None:
    assert is_loopback(address)


@pytest.mark.parametrize("address", [ANY, "::", "10.0.0.1", "::ffff:10.0.0.1", "fe80::1%eth0", "cell1", ""])
def test_other_machines_reach_every_other_address(address: str) -> None:
    assert not is_loopback(address)


@pytest.mark.slow  # listens
@pytest.mark.parametrize("host", [ANY, ""])
def test_beyond_this_machine_nobody_listens_without_a_token(host: str) -> None:
    with pytest.raises(UsageError, match="reached from other machines, and there is no token") as refused:
        listening(host, 0)
    assert "--token-file" in refused.value.hint

    with listening(host, 0, TOKEN) as listener:
        assert socket.gethostname().lower() in names_beyond(listener)


@pytest.mark.slow  # listens
def test_on_this_machine_nothing_is_asked_for() -> None:
    with listening("127.0.0.1", 0) as listener:
        assert names_beyond(listener) == frozenset()
        with pytest.raises(UsageError, match=r"cannot listen on 127\.0\.0\.1"):
            listening("127.0.0.1", listener.getsockname()[1])
    with pytest.raises(UsageError, match="0 to 65535"):
        listening("127.0.0.1", 99_999)


def test_a_token_is_read_from_a_file_that_is_its_owners_alone(tmp_path: Path) -> None:
    file = tmp_path / "token"
    file.write_text(TOKEN + "\n")
    file.chmod(0o600)

    assert read_token(file) == TOKEN


@pytest.mark.skipif(os.name != "posix", reason="rights of files are those of POSIX")
def test_a_token_that_others_may_read_is_refused(tmp_path: Path) -> None:
    file = tmp_path / "token"
    file.write_text(TOKEN)
    file.chmod(0o640)

    with pytest.raises(UsageError, match="others may read this token: its rights are 0640"):
        read_token(file)


@pytest.mark.parametrize("text", ["", "short", "x" * 513, "two words of them", "x" * 15, "\u00e9" * 20])
def test_what_is_no_token_is_refused_and_never_shown(tmp_path: Path, text: str) -> None:
    file = tmp_path / "token"
    file.write_text(text, encoding="utf-8")
    file.chmod(0o600)

    with pytest.raises(UsageError, match="token") as refused:
        read_token(file)
    assert not text or text not in str(refused.value)
