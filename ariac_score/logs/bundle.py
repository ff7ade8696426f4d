"""Which files are the parts of one trial: a file, a bag folder, or a folder of logs and configurations.

A bundle is one trial. Where a folder holds two candidates for one part, nothing is
guessed: `bundle.yaml` in the folder says which is meant.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence, Set
from dataclasses import dataclass, field, replace
from fnmatch import fnmatchcase
from pathlib import Path, PurePosixPath

from ariac_score.checks.contracts import Likening, Reader, ReaderFacts, reader_facts
from ariac_score.documents.schema import schema, schema_errors, validate
from ariac_score.documents.yaml import YamlDocument, is_there, load_yaml
from ariac_score.errors import DataFileError, LogError, NothingToScoreError, did_you_mean

__all__ = [
    "MAX_DEPTH",
    "MAX_FILES",
    "Bundle",
    "Part",
    "find_parts",
    "name_from",
    "with_parts",
    "without_stating",
]

BUNDLE_FILE = "bundle.yaml"
MAX_DEPTH = 4
"""How deep below the given folder is searched."""
MAX_FILES = 2000
"""With more files than this a folder is not taken for that of one trial."""

_RUN = re.compile(r"(?P<file>.+)#run=(?P<run>\d{1,15})")
_CORE_ROLES = ("trial_config", "team_config", "official")
"""The roles every competition has; readers may state further ones."""
_SHOWN = 5


@dataclass(frozen=True)
class Part:
    """One file (or bag folder) of a trial.

    Attributes:
        path: Where it is.
        reader: Name of the reader that recognised it.
        facts: The reader's facts about its files.
        run: The number of the chosen run, where one is named.
        given: Whether the caller gave it, as an organiser gives the configuration that all runs share;
            otherwise it lies with the run.
    """

    path: Path
    reader: str
    facts: ReaderFacts = field(default_factory=ReaderFacts)
    run: int | None = None
    given: bool = False

    @property
    def role(self) -> str:
        """Its part in the trial, such as `log`."""
        return self.facts.role


@dataclass(frozen=True)
class Bundle:
    """The parts of one trial.

    Attributes:
        id: Name of the trial: from `bundle.yaml`, or of the folder or file.
        root: The folder (or the file) the parts are in.
        parts: Sorted by path; those of `bundle.yaml` in its order.
        ignored: Paths below the root that no reader recognised, sorted.
        stated: The SHA-256 of files that `bundle.yaml` states, sorted by path.
        file: The `bundle.yaml` that names the parts, if one does.
    """

    id: str
    root: Path
    parts: tuple[Part, ...]
    ignored: tuple[str, ...] = ()
    stated: tuple[tuple[Path, str], ...] = ()
    file: Path | None = None

    @property
    def folder(self) -> Path:
        """The folder that names of its parts are relative to."""
        return self.root if self.root.is_dir() else self.root.parent


def find_parts(path: Path, readers: Mapping[str, Reader]) -> Bundle:
    """Find the parts of the trial at a path.

    Args:
        path: A log, a configuration, a bag folder, a `bundle.yaml`, or a folder of these. A file
            that holds several runs may be followed by the number of one: `results.db#run=3`.
        readers: The installed readers by name; tried in order of their names.

    Raises:
        NothingToScoreError: There is no such path, or nothing in it is recognised.
        LogError: The folder holds two trials, or `bundle.yaml` names what is not there.
        DataFileError: `bundle.yaml` is malformed or breaks its schema.
    """
    file, run = _split_run(path)
    if run is not None:
        return _single_run(file, run, readers)
    if path.is_file():
        return _named_parts(path, readers) if path.name == BUNDLE_FILE else _single_file(path, readers)
    if not path.is_dir():
        raise NothingToScoreError(
            "no such file or folder", file=path, hint="check the path; it is relative to the current folder"
        )
    if (path / BUNDLE_FILE).is_file():
        return _named_parts(path / BUNDLE_FILE, readers)
    bag = _as_folder(path, readers)
    if bag is not None:
        return _with_neighbours(Bundle(_folder_name(path), path, (bag,)), readers)
    return _searched_folder(path, readers)


def with_parts(bundle: Bundle, paths: Sequence[Path], root: Path, readers: Mapping[str, Reader]) -> Bundle:
    """A bundle with files from outside its folder, such as the configuration that all runs share.

    A part of the bundle that has the role of a further file stays, so that it can be held against that.

    Args:
        bundle: As found.
        paths: The further files.
        root: Folder that all names are relative to from now on.
        readers: The installed readers by name.

    Raises:
        LogError: A file is not recognised, or two have one role.
    """
    if not paths:
        return bundle
    found = [replace(_recognised(path, readers), given=True) for path in paths]
    own = {part.path.resolve() for part in found}  # an organiser may keep it in the folder of the run
    kept = tuple(part for part in bundle.parts if part.path.resolve() not in own)
    return replace(bundle, root=root, parts=(*kept, *found))


def without_stating(bundle: Bundle, roles: Set[str]) -> Bundle:
    """A bundle without the parts that lie with the run, have one of some roles, and nobody gave.

    They are named among what was ignored: whoever hands in a run could state with them what is not his.
    """
    given = {part.role for part in bundle.parts if part.given}
    left_out = [p for p in bundle.parts if p.role in roles - given and not p.given]
    names = (f"{name_from(bundle.folder, part.path)} (not given by the organiser)" for part in left_out)
    return replace(
        bundle,
        parts=tuple(part for part in bundle.parts if part not in left_out),
        ignored=tuple(sorted([*bundle.ignored, *names])),
        stated=tuple(
            (path, digest) for path, digest in bundle.stated if path not in {p.path for p in left_out}
        ),
    )


def _recognised(path: Path, readers: Mapping[str, Reader]) -> Part:
    part = _as_part(path, readers)
    if part is None:
        raise LogError(
            "no reader recognises this file", file=path, hint=f"known formats: {known_formats(readers)}"
        )
    return part


def name_from(root: Path, file: Path) -> str:
    """The name of a file as results give it: relative to a folder, or its own where it lies elsewhere."""
    return file.relative_to(root).as_posix() if file.is_relative_to(root) else file.name


def _folder_name(folder: Path) -> str:
    return folder.resolve().name or "trial"


def _as_part(path: Path, readers: Mapping[str, Reader]) -> Part | None:
    """The part a file is, by the first reader that recognises it.

    Raises:
        LogError: It may not be read: it could be a part that the trial must not be scored without.
    """
    for name in sorted(readers):  # not in the order of installation, which differs between machines
        if readers[name].can_read(path):
            return Part(path, name, reader_facts(readers[name]))
    try:
        if path.is_file():
            path.open("rb").close()
    except OSError as cause:
        raise LogError(
            f"cannot be read: {cause.strerror}", file=path, hint="check the permissions of the file"
        ) from cause
    return None


def _as_folder(folder: Path, readers: Mapping[str, Reader]) -> Part | None:
    """The part that a whole folder is, for readers whose logs may be folders."""
    for name in sorted(readers):
        facts = reader_facts(readers[name])
        if facts.folders and readers[name].can_read(folder):
            return Part(folder, name, facts)
    return None


def known_formats(readers: Mapping[str, Reader]) -> str:
    """The formats of the installed readers, for error messages."""
    return ", ".join(sorted({facts.formats for r in readers.values() if (facts := reader_facts(r)).formats}))


def _single_file(path: Path, readers: Mapping[str, Reader]) -> Bundle:
    part = _as_part(path, readers)
    if part is None:
        cause = (
            f"no reader recognises this file{_likeness(path, readers)}"
            if path.stat().st_size
            else "the file is empty"
        )
        raise NothingToScoreError(cause, file=path, hint=f"known formats: {known_formats(readers)}")
    return _with_neighbours(Bundle(path.stem, path, (part,)), readers)


def _with_neighbours(bundle: Bundle, readers: Mapping[str, Reader]) -> Bundle:
    """A log with the files beside it that its reader says belong to it.

    Raises:
        LogError: Two of them have one role.
    """
    (log,) = bundle.parts
    folder = bundle.root.resolve().parent
    if not log.facts.beside:
        return bundle
    names = sorted(
        file
        for file in folder.iterdir()
        if file.is_file() and any(fnmatchcase(file.name, pattern) for pattern in log.facts.beside)
    )
    found = [part for file in names if (part := _as_part(file, readers)) and part.role != "log"]
    if not found:
        return bundle
    _refuse_two_trials(found, folder)
    return replace(bundle, root=folder, parts=(log, *found))


def _likeness(path: Path, readers: Mapping[str, Reader]) -> str:
    """What a YAML file that is no part of a trial looks like, for an error message."""
    if path.suffix not in (".yaml", ".yml"):
        return ""
    found = (r.likeness(path) for _, r in sorted(readers.items()) if isinstance(r, Likening))
    return next((f"; it looks like {likeness.words}" for likeness in found if likeness), "")


def _split_run(path: Path) -> tuple[Path, int | None]:
    """A path without the run it names, and the run; a file that really has such a name is itself.

    >>> _split_run(Path("day_1/results.db#run=3"))[1], _split_run(Path("results.db#3"))[1]
    (3, None)
    """
    named = _RUN.fullmatch(path.name)
    if named is None or path.exists():  # a file may really be called so
        return path, None
    return path.with_name(named["file"]), int(named["run"])


def _single_run(path: Path, run: int, readers: Mapping[str, Reader]) -> Bundle:
    if not path.is_file():
        raise NothingToScoreError("no such file", file=path, hint="check the path before '#run='")
    (part,) = _single_file(path, readers).parts
    return Bundle(f"{path.stem}_run_{run}", path, (_of_run(part, run, file=path, place=""),))


def _of_run(part: Part, run: int, *, file: Path, place: str) -> Part:
    if not part.facts.holds_runs:
        raise LogError(
            f"{part.path.name!r} is {part.facts.a_file} of one run, so none can be chosen from it",
            file=file,
            place=place,
            hint="name a run only of a file that holds several, such as a database",
        )
    return replace(part, run=run)


def _searched_folder(folder: Path, readers: Mapping[str, Reader]) -> Bundle:
    parts: list[Part] = []
    ignored: list[str] = []
    for path in _candidates(folder, readers):
        part = _as_folder(path, readers) if path.is_dir() else _as_part(path, readers)
        if part is None:
            ignored.append(path.relative_to(folder).as_posix())
        else:
            parts.append(part)
    ignored += [
        f"{link.relative_to(folder).as_posix()} (a link to somewhere else)" for link in _links_out(folder)
    ]
    if not parts:
        raise NothingToScoreError(
            f"nothing to score in this folder; {_seen(ignored)}",
            file=folder,
            hint=f"known formats: {known_formats(readers)}",
        )
    _refuse_two_trials(parts, folder)
    return Bundle(_folder_name(folder), folder, tuple(parts), tuple(sorted(ignored)))


def _seen(ignored: list[str]) -> str:
    if not ignored:
        return "it holds no files"
    more = f" and {len(ignored) - _SHOWN} more" if len(ignored) > _SHOWN else ""
    return "not recognised: " + ", ".join(sorted(ignored)[:_SHOWN]) + more


def _candidates(folder: Path, readers: Mapping[str, Reader]) -> Iterator[Path]:
    """Files and bag folders below a folder, sorted, with nothing from outside it."""
    root = folder.resolve()
    # Counted while walking, so that a home folder given by mistake is left after some files.
    for seen, path in enumerate(_walk(folder, root, readers, MAX_DEPTH)):
        if seen >= MAX_FILES:
            raise LogError(
                f"more than {MAX_FILES} files: this does not look like the folder of one trial",
                file=folder,
                hint=f"name the folder of one trial, or write {BUNDLE_FILE} in it",
            )
        yield path


def _walk(folder: Path, root: Path, readers: Mapping[str, Reader], depth: int) -> Iterator[Path]:
    try:
        paths = sorted(folder.iterdir())
    except OSError as cause:
        raise LogError(
            f"cannot be listed: {cause.strerror}", file=folder, hint="check the permissions"
        ) from cause
    for path in paths:
        if not _is_inside(path, root):
            continue  # a link out of the folder; `_links_out` names it
        if path.is_file() or (path.is_dir() and _as_folder(path, readers) is not None):
            yield path
        elif path.is_dir() and not path.is_symlink() and depth > 0:  # links could form loops
            yield from _walk(path, root, readers, depth - 1)


def _links_out(folder: Path) -> list[Path]:
    """The links directly in a folder that lead out of it, or nowhere."""
    root = folder.resolve()
    return sorted(
        path
        for path in folder.iterdir()
        if path.is_symlink() and (not _is_inside(path, root) or not path.exists())
    )


def _is_inside(path: Path, root: Path) -> bool:
    """Whether a path, links followed, is in a folder whose own links are followed."""
    try:
        return path.resolve().is_relative_to(root)
    except (OSError, RuntimeError):  # a loop of links
        return False


def _refuse_two_trials(parts: list[Part], where: Path) -> None:
    """One part for each role, and one log for each kind of log."""
    taken: dict[tuple[str, str], Part] = {}
    for part in parts:
        # A bag and a Gazebo log of one trial belong together; two bags may be two trials.
        one_of = (part.role, part.reader if part.role == "log" else "")
        first = taken.setdefault(one_of, part)
        if first is not part:
            raise LogError(
                f"two trials in one bundle: {first.path.as_posix()!r} and {part.path.as_posix()!r} "
                f"are each {part.facts.a_file}",
                file=where,
                hint=f"score them one by one, or write {BUNDLE_FILE} to say which belong together",
            )


def _named_parts(file: Path, readers: Mapping[str, Reader]) -> Bundle:
    """The parts that `bundle.yaml` names."""
    document = load_yaml(file)
    roles = _roles(readers)
    _refuse_unknown_keys(document, roles)
    validate(document, "bundle")
    named = document.data
    parts = [
        _named_part(document, file, path, "log", ("logs", i), readers) for i, path in enumerate(named["logs"])
    ]
    parts += [
        _named_part(document, file, named[role], role, (role,), readers) for role in roles if role in named
    ]
    if "run" in named:
        place = document.place(("run",))
        parts = [
            _of_run(part, named["run"], file=file, place=place) if part.role == "official" else part
            for part in parts
        ]
    if not parts:
        raise NothingToScoreError(
            "the bundle names no part", file=file, hint="name at least one log or configuration"
        )
    stated = tuple(sorted((file.parent / name, digest) for name, digest in named.get("sha256", {}).items()))
    name = named.get("id") or _folder_name(file.parent)
    return Bundle(name, file.parent, tuple(parts), stated=stated, file=file)


def _roles(readers: Mapping[str, Reader]) -> list[str]:
    """The roles that `bundle.yaml` can name besides `logs`: those of every trial, then those of readers."""
    own = {reader_facts(reader).role for reader in readers.values()}
    # A role called like another key of the file, such as `run`, could not be told from it.
    return [*_CORE_ROLES, *sorted(own - {"log", *schema("bundle")["properties"]})]


def _a_file(role: str, readers: Mapping[str, Reader]) -> str:
    """A file of a role in words, as its reader states them."""
    stated = (reader_facts(reader) for _, reader in sorted(readers.items()))
    return next((facts.a_file for facts in stated if facts.role == role), f"a file of role {role!r}")


def _refuse_unknown_keys(document: YamlDocument, roles: Sequence[str]) -> None:
    """Refuse a misspelt key; the schema cannot, for it does not know which readers are installed.

    Raises:
        DataFileError: A key is neither of the schema nor a role of an installed reader.
    """
    if not isinstance(document.data, dict):
        return  # the schema says what is wrong
    known = dict.fromkeys([*schema("bundle")["properties"], *roles])
    unknown = sorted(str(key) for key in document.data if key not in known)
    if unknown:
        rest = {key: value for key, value in document.data.items() if key in known}
        others = len(schema_errors(rest, "bundle")) + len(unknown) - 1
        raise DataFileError(
            f"unknown key {unknown[0]!r}" + (f" (and {others} more)" if others else ""),
            file=document.file,
            place=document.place([unknown[0]]),
            hint=did_you_mean(unknown[0], known, what="known keys"),
        )


def _named_part(
    document: YamlDocument,
    file: Path,
    name: str,
    role: str,
    place: tuple[str | int, ...],
    readers: Mapping[str, Reader],
) -> Part:
    where = document.place(place)
    plain = PurePosixPath(name)
    path = file.parent / name
    # A bundle may come from a stranger: nothing outside its folder may be read, or quoted in a result.
    inside = not (plain.is_absolute() or Path(name).is_absolute() or ".." in plain.parts or "\0" in name)
    if not inside or not _is_inside(path, file.parent.resolve()):
        raise LogError(
            f"{name!r} leads out of the bundle's folder",
            file=file,
            place=where,
            hint="copy the file into the folder and name it relative to it",
        )
    if not is_there(path):
        raise LogError(
            f"{name[:200]!r} does not exist",
            file=file,
            place=where,
            hint="check the name, or remove the entry",
        )
    part = _as_folder(path, readers) if path.is_dir() else _as_part(path, readers)
    if part is None or part.role != role:
        found = "is not recognised" if part is None else f"is {part.facts.a_file}"
        raise LogError(
            f"{name!r} {found}, not {_a_file(role, readers)}",
            file=file,
            place=where,
            hint=f"known formats: {known_formats(readers)}",
        )
    return part
