"""The adversary as a search for `rules prove`: what it finds on a log refutes the law that it breaks."""

from __future__ import annotations

from hashlib import sha256
from pathlib import Path

from ariac_score.redteam.attempt import Aim, Tactic
from ariac_score.redteam.honest import Honest
from ariac_score.redteam.search import Exploit, search
from ariac_score.redteam.tactics import TACTICS
from ariac_score.review.laws.laws import Broken, Law
from ariac_score.review.laws.proving import Outcome
from ariac_score.review.proofs.proving import Search
from ariac_score.review.proofs.subject import Subject

__all__ = ["DEFAULT_TRIES", "adversary", "sha256_of"]

DEFAULT_TRIES = 24
"""So many logs at most are doctored and scored for each law that is open."""

_OMISSIONS = ("topics left out", "samples left out")
"""Of what is left out, nothing is known; single messages that nobody misses are none of these."""


def adversary(honest: Honest, *, tries: int, seed: int) -> Search:
    """A search among doctored copies of an honest log, for each law that a tactic would break.

    Args:
        honest: The log, under the rules whose laws are proven.
        tries: How often to try, for each law.
        seed: Of what is tried by chance.
    """

    def look(_: Subject, law: Law) -> Outcome | None:
        tactics = [tactic.name for tactic in TACTICS if law.name in _laws(tactic)]
        if not tactics:
            return None
        found = search(honest, budget=tries, seed=seed, tactics=tactics)
        broken = [one for one in found.exploits if _breaks(one, law)]
        if not broken:
            return Outcome(law, "holds", cases=found.tried)
        words = f"the log {honest.path.name}"
        return Outcome(law, "broken", cases=found.tried, broken=_story(broken[0]), log=words)

    return Search(f"doctored copies of {honest.path.name}", look)


def _laws(tactic: Tactic) -> tuple[str, ...]:
    """The laws that a tactic would break."""
    if tactic.name in _OMISSIONS:
        return ("unknown",)
    # What more violation brings, it does not cost either; where nothing is left, nobody may tell.
    more = ("always_costs", "nothing_left") if tactic.law == "more_violations" else ()
    return (tactic.law, *more)


def _breaks(exploit: Exploit, law: Law) -> bool:
    """Whether it shows that the rules break the law, and not what no rules can avoid or no log can show."""
    if exploit.standing not in ("exploit", "declared"):
        return False
    if law.name == "always_costs" and exploit.law == "more_violations":
        return True
    return exploit.tactic.aim is Aim.LIE or law.name == exploit.law


def _story(exploit: Exploit) -> Broken:
    return Broken("as it is", float(exploit.before), exploit.says, float(exploit.after))


def sha256_of(path: Path) -> str:
    """Of a recording, or of all files of a folder with their names."""
    if path.is_file():
        return sha256(path.read_bytes()).hexdigest()
    whole = sha256()
    for file in sorted(file for file in path.rglob("*") if file.is_file()):
        whole.update(f"{file.relative_to(path).as_posix()} {sha256_of(file)}\n".encode())
    return whole.hexdigest()
