"""Results on disk: one SQLite row per job, written as the job ends."""

from __future__ import annotations

import json
import sqlite3
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from types import TracebackType
from typing import Any

from roadscope.benchmarks.metrics.score import Score

APPLICATION_ID = 0x52534350
"""`RSCP`, marks the file as ours in its SQLite header."""
SCHEMA_VERSION = 1
BATCH = 500

SCHEMA = """
CREATE TABLE IF NOT EXISTS manifests (id INTEGER PRIMARY KEY, content TEXT NOT NULL);
CREATE TABLE IF NOT EXISTS results (
    key TEXT PRIMARY KEY, board TEXT NOT NULL, entry TEXT NOT NULL, scenario TEXT NOT NULL,
    seed INTEGER NOT NULL, spec TEXT NOT NULL, scores TEXT NOT NULL, reason TEXT,
    manifest INTEGER NOT NULL REFERENCES manifests (id), finished TEXT NOT NULL
);
"""


class StoreError(ValueError):
    """A results file could not be used."""


@dataclass(frozen=True, slots=True)
class Outcome:
    """What became of one job.

    scores: by metric; empty when the job failed.
    reason: why it failed, or None.
    """

    scores: Mapping[str, Score]
    reason: str | None = None


@dataclass(frozen=True, slots=True)
class StoredJob:
    """What a row says about its job.

    spec: everything that the key was hashed from, as JSON.
    """

    key: str
    board: str
    entry: str
    scenario: str
    seed: int
    spec: str


class Store:
    """A results file; use it as a context manager. One process writes, others may read."""

    def __init__(self, path: Path | str) -> None:
        """Open or make the file; a corrupt or foreign one raises `StoreError`."""
        self.path = Path(path)
        try:
            self.path.parent.mkdir(parents=True, exist_ok=True)
            self._db = sqlite3.connect(self.path, isolation_level=None)
        except (OSError, sqlite3.Error) as error:
            raise StoreError(f"cannot open results file {self.path}: {error}") from error
        try:
            self._prepare()
        except sqlite3.Error as error:
            self._db.close()
            raise StoreError(
                f"results file {self.path} is not usable: {error}; move it away or name another "
                "folder with --out"
            ) from error
        except StoreError:
            self._db.close()
            raise

    def __enter__(self) -> Store:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._db.close()

    def begin(self, manifest: Mapping[str, Any]) -> int:
        """Note the conditions of a run and return their number."""
        text = json.dumps(manifest, sort_keys=True)
        cursor = self._execute("INSERT INTO manifests (content) VALUES (?)", (text,))
        assert cursor.lastrowid is not None
        return cursor.lastrowid

    def put(self, job: StoredJob, outcome: Outcome, manifest: int) -> None:
        """Write the outcome of a job, durable when this returns."""
        scores = json.dumps({k: s.to_json() for k, s in outcome.scores.items()}, allow_nan=False)
        row = (
            job.key, job.board, job.entry, job.scenario, job.seed, job.spec, scores,
            outcome.reason, manifest, datetime.now(UTC).isoformat(timespec="seconds"),
        )  # fmt: skip
        self._execute(f"INSERT OR REPLACE INTO results VALUES ({', '.join('?' * 10)})", row)

    def outcomes(self, keys: Iterable[str]) -> dict[str, Outcome]:
        """Return what is known of the jobs with these keys; what cannot be read is not."""
        wanted, found = list(keys), {}
        for start in range(0, len(wanted), BATCH):
            batch = wanted[start : start + BATCH]
            marks = ", ".join("?" * len(batch))
            query = f"SELECT key, scores, reason FROM results WHERE key IN ({marks})"
            for key, scores, reason in self._execute(query, batch).fetchall():
                try:
                    named = {k: Score.from_json(v) for k, v in json.loads(scores).items()}
                except (ValueError, TypeError, KeyError, AttributeError):
                    continue
                found[key] = Outcome(named, reason)
        return found

    def _execute(self, query: str, values: Sequence[Any]) -> sqlite3.Cursor:
        try:
            return self._db.execute(query, values)
        except sqlite3.Error as error:
            raise StoreError(
                f"results file {self.path} is not usable: {error}; move it away or name another "
                "folder with --out"
            ) from error

    def _prepare(self) -> None:
        (tables,) = self._db.execute("SELECT count(*) FROM sqlite_master").fetchone()
        (application,) = self._db.execute("PRAGMA application_id").fetchone()
        (schema,) = self._db.execute("PRAGMA user_version").fetchone()
        if tables and application != APPLICATION_ID:
            raise StoreError(f"{self.path} is a database of another program; it was left alone")
        if tables and schema != SCHEMA_VERSION:
            raise StoreError(
                f"{self.path} has results format {schema}, this version reads {SCHEMA_VERSION}"
            )
        (health,) = self._db.execute("PRAGMA quick_check(1)").fetchone()
        if health != "ok":
            raise sqlite3.DatabaseError(health)
        self._db.execute("PRAGMA journal_mode = WAL")
        self._db.execute("PRAGMA synchronous = NORMAL")
        self._db.execute("PRAGMA busy_timeout = 10000")
        self._db.execute(f"PRAGMA application_id = {APPLICATION_ID}")
        self._db.execute(f"PRAGMA user_version = {SCHEMA_VERSION}")
        self._db.executescript(SCHEMA)
