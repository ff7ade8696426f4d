"""Tables of a season as a folder of Parquet files, and queries over it by a program of others."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from ariac_score.batch.index import INDEX, RUNS, Row, _write_index
from ariac_score.batch.outcomes import CheckCounts, Summary
from ariac_score.cli import main

parquet = pytest.importorskip("pyarrow.parquet", reason="the extra 'parquet' is not installed")


def season(folder: Path, teams: int, trials: int, runs: int) -> Path:
    """The tables of a season, without its documents: `score` of a run is its number in the season."""

    def rows() -> Iterator[Row]:
        number = 0
        for team in range(teams):
            for trial in range(trials):
                for run in range(1, runs + 1):
                    number += 1
                    key = (f"team {team:03d}", f"kit/{trial:02d}", run)
                    if number % 10 == 0:
                        yield Row.of(key, Summary("crashed", "signal 11", None, None))
                        continue
                    counts = {"satisfied": 2, "violated": number % 3, "inconclusive": 0, "not_applicable": 0}
                    checks = (CheckCounts("separation", 0.5 - number % 3, **counts),)
                    yield Row.of(key, Summary("scored", "", float(number), float(number), checks))

    folder.mkdir()
    (folder / RUNS).write_text("".join(row.as_line() for row in rows()), encoding="ascii")
    _write_index(folder / INDEX, iter((folder / RUNS).read_text(encoding="ascii").splitlines(keepends=True)))
    return folder


def test_each_team_has_a_file_and_its_name_is_that_of_the_folder(tmp_path: Path) -> None:
    made = season(tmp_path / "season", 2, 2, 5)

    assert main(["-q", "export", str(made), "--by", "team", "-o", str(tmp_path / "runs")]) == 0

    files = sorted(
        path.relative_to(tmp_path / "runs").as_posix() for path in (tmp_path / "runs").rglob("*.parquet")
    )
    assert files == ["team=team%20000/runs.parquet", "team=team%20001/runs.parquet"]
    first = parquet.read_table(tmp_path / "runs" / files[0], partitioning=None)
    assert "team" not in first.column_names
    assert first.column("score").to_pylist() == [1.0, 2, 3, 4, 5, 6, 7, 8, 9, None]


def test_other_columns_and_tables_are_split_alike_and_twice_the_same(tmp_path: Path) -> None:
    made = season(tmp_path / "season", 2, 3, 2)

    for name in ("a", "b"):
        words = ["--table", "checks", "--by", "trial", "-o", str(tmp_path / name)]
        assert main(["-q", "export", str(made), *words]) == 0

    files = [sorted((tmp_path / name).rglob("*.parquet")) for name in ("a", "b")]
    assert [path.parent.name for path in files[0]] == ["trial=kit%2F00", "trial=kit%2F01", "trial=kit%2F02"]
    assert [path.read_bytes() for path in files[0]] == [path.read_bytes() for path in files[1]]
    assert parquet.read_table(files[0][0], partitioning=None).column("run").to_pylist() == [1, 2, 1, 2]


def test_a_folder_in_use_or_no_folder_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    made = season(tmp_path / "season", 1, 1, 1)
    (tmp_path / "used").mkdir()
    (tmp_path / "used/mine").touch()

    assert main(["export", str(made), "--by", "team", "-o", str(tmp_path / "used")]) == 4
    assert "it is not an empty folder" in capsys.readouterr().err
    assert main(["export", str(made), "--by", "team"]) == 4
    assert "--by writes a folder" in capsys.readouterr().err


@pytest.mark.slow
@pytest.mark.timeout(300)
def test_a_hundred_thousand_runs_are_queried_in_place(tmp_path: Path) -> None:
    duckdb = pytest.importorskip("duckdb", reason="duckdb is not here; it comes with the extra 'dev'")
    made = season(tmp_path / "season", 50, 20, 100)
    for table in ("runs", "checks"):
        words = ["--table", table, "--by", "team", "-o", str(tmp_path / table)]
        assert main(["-q", "export", str(made), *words]) == 0

    with duckdb.connect() as base:
        for table in ("runs", "checks"):
            files = f"read_parquet('{tmp_path}/{table}/*/*.parquet', hive_partitioning=true)"
            base.execute(f"CREATE VIEW {table} AS SELECT * FROM {files}")  # noqa: S608  # of ours
        counted = base.execute(
            "SELECT outcome, count(*), sum(score) FROM runs GROUP BY outcome ORDER BY outcome"
        ).fetchall()
        worst = base.execute(
            "SELECT team, sum(violated), max(score) FROM runs JOIN checks USING (team, trial, run) "
            "WHERE name = 'separation' GROUP BY team ORDER BY team LIMIT 1"
        ).fetchall()

    scored = [n for n in range(1, 100_001) if n % 10]
    assert counted == [("crashed", 10_000, None), ("scored", 90_000, float(sum(scored)))]
    of_the_first = [n for n in scored if n <= 2000]
    assert worst == [("team 000", sum(n % 3 for n in of_the_first), 1999.0)]
