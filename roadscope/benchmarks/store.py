"""Results on disk: one SQLite row per job, written as the job ends."""

from __future__ import annotations

import json
import sqlite3
import warnings
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from datetime import UTC, datetime
from functools import partial
from hashlib import sha256
from pathlib import Path
from typing import Any

from roadscope.benchmarks.metrics.score import Score

APPLICATION_ID = 0x52534350
"""`RSCP`, which marks the file as one of roadscope in its SQLite header."""
SCHEMA_VERSION = 2
BATCH = 500
"""Most keys in one query; SQLite limits how many values one may have."""
LOG_LENGTH = 10_000
"""Longest log in a row, characters; chosen by hand."""

TABLES = """
CREATE TABLE IF NOT EXISTS manifests (id INTEGER PRIMARY KEY, content TEXT NOT NULL);
CREATE TABLE IF NOT EXISTS results (
    key TEXT PRIMARY KEY, board TEXT NOT NULL, entry TEXT NOT NULL, scenario TEXT NOT NULL,
    seed INTEGER NOT NULL, spec TEXT NOT NULL, scores TEXT NOT NULL, reason TEXT,
    manifest INTEGER NOT NULL REFERENCES manifests (id), finished TEXT NOT NULL,
    inputs TEXT NOT NULL DEFAULT '', condition TEXT NOT NULL DEFAULT '',
    log TEXT NOT NULL DEFAULT '', digest TEXT NOT NULL DEFAULT ''
);
"""
COLUMNS = (
    *("key", "board", "entry", "scenario", "seed", "spec", "scores", "reason", "manifest"),
    *("finished", "inputs", "condition", "log"),
)
"""The columns that the digest of a row covers, in this order."""


class StoreError(ValueError):
    """A results file cannot be used."""


@dataclass(frozen=True, slots=True)
class Outcome:
    """The result of one job.

    scores: by metric; empty when the job failed.
    reason: why it failed, or None.
    log: what a failed plug-in printed; the store keeps its last `LOG_LENGTH` characters.
    """

    scores: Mapping[str, Score]
    reason: str | None = None
    log: str = ""


@dataclass(frozen=True, slots=True)
class StoredJob:
    """The columns of a row that describe its job.

    spec: everything that the key was hashed from, as JSON.
    inputs: the detector whose detections the entry got; empty if it got none.
    condition: weather, light and faults in words.
    """

    key: str
    board: str
    entry: str
    scenario: str
    seed: int
    spec: str
    inputs: str = ""
    condition: str = ""


class Store:
    """A results file; use it as a context manager. One process writes, others may read."""

    def __init__(self, path: Path | str) -> None:
        """Open or make the file; a corrupt or foreign one raises `StoreError`."""
        self.path = Path(path)
        self._digests: dict[str, str] = {}
        try:
            self.path.parent.mkdir(parents=True, exist_ok=True)
            self._db = sqlite3.connect(self.path, isolation_level=None)
        except (OSError, sqlite3.Error) as error:
            raise StoreError(f"cannot open results file {self.path}: {error}") from error
        # Damaged text may be no UTF-8; then the digest of its row does not fit.
        self._db.text_factory = partial(str, encoding="utf-8", errors="replace")
        try:
            self._prepare()
        except BaseException:
            self._db.close()
            raise

    def __enter__(self) -> Store:
        return self

    def __exit__(self, *error: object) -> None:
        self._db.close()

    def begin(self, manifest: Mapping[str, Any]) -> int:
        """Write the manifest of a run and return its number."""
        text = json.dumps(manifest, sort_keys=True)
        self._execute("INSERT INTO manifests (content) VALUES (?)", (text,))
        return int(self._execute("SELECT last_insert_rowid()")[0][0])

    def put(self, job: StoredJob, outcome: Outcome, manifest: int) -> None:
        """Write the outcome of a job; it is on disk when this returns."""
        scores = json.dumps({k: s.to_json() for k, s in outcome.scores.items()}, allow_nan=False)
        finished = datetime.now(UTC).isoformat(timespec="seconds")
        row = {
            **asdict(job),
            "scores": scores,
            "reason": outcome.reason,
            "log": outcome.log[-LOG_LENGTH:],
            "manifest": manifest,
            "finished": finished,
        }
        values = [row[name] for name in COLUMNS]
        digest = _digest(values)
        names, marks = ", ".join((*COLUMNS, "digest")), ", ".join("?" * (len(COLUMNS) + 1))
        query = f"INSERT OR REPLACE INTO results ({names}) VALUES ({marks})"
        self._execute(query, [*values, digest])
        self._digests[job.key] = digest

    def outcomes(self, keys: Iterable[str]) -> dict[str, Outcome]:
        """Return the stored outcomes of the jobs with these keys.

        A damaged row, whose digest does not fit its content, is left out with a warning.
        """
        outcomes = {}
        for row, digest in self._rows(keys):
            outcome = _outcome(row) if digest == _digest(list(row.values())) else None
            if outcome is None:
                warnings.warn(
                    f"{self.path}: the row of {row['entry']} on {row['scenario']}, seed "
                    f"{row['seed']}, is damaged and does not count",
                    stacklevel=2,
                )
            else:
                outcomes[row["key"]] = outcome
                self._digests[row["key"]] = digest
        return outcomes

    def changed(self) -> list[str]:
        """Return the keys of rows that are no longer as they were last read or written here."""
        present = {row["key"]: _digest(list(row.values())) for row, _ in self._rows(self._digests)}
        return [key for key, digest in self._digests.items() if present.get(key) != digest]

    def _rows(self, keys: Iterable[str]) -> Iterator[tuple[dict[str, Any], str]]:
        """Yield the rows with these keys, and the digest that each of them has."""
        wanted = list(keys)
        for start in range(0, len(wanted), BATCH):
            batch = wanted[start : start + BATCH]
            marks = ", ".join("?" * len(batch))
            query = f"SELECT {', '.join(COLUMNS)}, digest FROM results WHERE key IN ({marks})"
            for *values, digest in self._execute(query, batch):
                yield dict(zip(COLUMNS, values, strict=True)), digest

    def spec(self, **columns: str | int) -> str | None:
        """Return the `StoredJob.spec` of the latest row with these values; None without one."""
        where = " AND ".join(f"{name} = ?" for name in columns)
        query = f"SELECT spec FROM results WHERE {where} ORDER BY finished DESC, manifest DESC"
        rows = self._execute(query, list(columns.values()))
        return str(rows[0][0]) if rows else None

    def _execute(self, query: str, values: Sequence[Any] = ()) -> list[Any]:
        """Return all rows of a query; a damaged page may be met at any of them."""
        try:
            return self._db.execute(query, values).fetchall()
        except sqlite3.Error as error:
            raise self._unusable(str(error)) from error

    def _unusable(self, reason: str) -> StoreError:
        return StoreError(
            f"results file {self.path} is not usable: {reason}; move it away or name another "
            "folder with --out"
        )

    def _prepare(self) -> None:
        ((tables,),) = self._execute("SELECT count(*) FROM sqlite_master")
        ((application,),) = self._execute("PRAGMA application_id")
        ((schema,),) = self._execute("PRAGMA user_version")
        if tables and application != APPLICATION_ID:
            raise StoreError(f"{self.path} is a database of another program; it was left alone")
        if tables and schema != SCHEMA_VERSION:
            raise self._unusable(f"it has format {schema}, this version reads {SCHEMA_VERSION}")
        ((health,),) = self._execute("PRAGMA quick_check(1)")
        if health != "ok":
            raise self._unusable(health)
        # No write-ahead log: SQLite maps its index into memory, and this process would die of a
        # bus error if a plug-in shortened that file.
        for setting in ("busy_timeout = 10000", "journal_mode = DELETE", "synchronous = NORMAL"):
            self._execute(f"PRAGMA {setting}")
        self._execute(f"PRAGMA application_id = {APPLICATION_ID}")
        self._execute(f"PRAGMA user_version = {SCHEMA_VERSION}")
        for table in filter(str.strip, TABLES.split(";")):
            self._execute(table)


def _digest(values: Sequence[Any]) -> str:
    """Hash the values of a row's columns."""
    # SQLite returns bytes where a damaged column has another type than was written.
    return sha256(json.dumps(list(values), default=repr).encode()).hexdigest()


def _outcome(row: Mapping[str, Any]) -> Outcome | None:
    """Read a row, or return None if its scores have another layout."""
    try:
        named = {k: Score.from_json(v) for k, v in json.loads(row["scores"]).items()}
    except (ValueError, TypeError, KeyError, AttributeError):
        return None
    return Outcome(named, row["reason"], row["log"])
