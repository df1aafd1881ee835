import math
import sqlite3
from dataclasses import replace
from pathlib import Path

import pytest

from roadscope.benchmarks import LOG_LENGTH, Outcome, Store, StoredJob, StoreError
from roadscope.benchmarks.metrics import Score, ratio, rms

SCORES = {
    "rate": ratio(3, 4),
    "error": rms(2.0, 3, "m"),
    "none": Score(math.nan, "1", "higher", 0, -math.inf, 1.0),
}


def job(key: str) -> StoredJob:
    return StoredJob(key, "detection", "mine", "motorway", 1, "{}")


def test_another_reader_finds_stored_outcomes(tmp_path) -> None:
    path = tmp_path / "results.sqlite"
    with Store(path) as store:
        number = store.begin({"a": 1})
        store.put(job("k1"), Outcome(SCORES), number)
        store.put(job("k2"), Outcome({}, "it broke"), number)
        with Store(path) as reader:
            stored = reader.outcomes(["k1", "k2", "k3"])
    assert set(stored) == {"k1", "k2"}
    assert stored["k2"].reason == "it broke"
    assert stored["k1"].scores["rate"] == SCORES["rate"]
    assert stored["k1"].scores["error"] == SCORES["error"]
    assert math.isnan(stored["k1"].scores["none"].value)
    assert stored["k1"].scores["none"].least == -math.inf


def test_a_job_done_again_replaces_its_row(tmp_path) -> None:
    with Store(tmp_path / "results.sqlite") as store:
        number = store.begin({})
        store.put(job("k"), Outcome({}, "it broke"), number)
        store.put(job("k"), Outcome(SCORES), number)
        assert store.outcomes(["k"])["k"].reason is None


def test_many_keys_at_once(tmp_path) -> None:
    with Store(tmp_path / "results.sqlite") as store:
        number = store.begin({})
        store.put(job("1999"), Outcome({}), number)
        assert list(store.outcomes(map(str, range(2000)))) == ["1999"]


def test_a_file_that_is_no_database_is_refused_and_left_alone(tmp_path) -> None:
    path = tmp_path / "results.sqlite"
    path.write_bytes(b"not a database at all, but long enough to be looked at" * 50)
    before = path.read_bytes()
    with pytest.raises(StoreError, match="not usable"):
        Store(path)
    assert path.read_bytes() == before


def test_a_database_of_another_program_is_refused_and_left_alone(tmp_path) -> None:
    path = tmp_path / "results.sqlite"
    other = sqlite3.connect(path)
    other.execute("CREATE TABLE results (key TEXT)")
    other.commit()
    other.close()
    before = path.read_bytes()
    with pytest.raises(StoreError, match="another program"):
        Store(path)
    assert path.read_bytes() == before


def test_a_damaged_database_is_refused(tmp_path) -> None:
    path = tmp_path / "results.sqlite"
    with Store(path) as store:
        number = store.begin({})
        for key in range(200):
            store.put(job(str(key)), Outcome(SCORES), number)
    content = bytearray(path.read_bytes())
    content[4096:12288] = b"\xff" * 8192
    path.write_bytes(content)
    with pytest.raises(StoreError, match="not usable"):
        Store(path)


def test_files_that_are_emptied_while_it_is_open_end_no_process(tmp_path) -> None:
    with Store(tmp_path / "results.sqlite") as store:
        number = store.begin({})
        store.put(job("k1"), Outcome(SCORES), number)
        for path in tmp_path.iterdir():
            path.write_bytes(b"")
        with pytest.raises(StoreError, match="not usable"):
            store.put(job("k2"), Outcome(SCORES), number)


def test_a_page_that_is_damaged_while_it_is_open_is_no_error_of_sqlite(tmp_path) -> None:
    path = tmp_path / "results.sqlite"
    with Store(path) as store:
        number = store.begin({})
        keys = [f"{number:03d}" for number in range(100)]
        for key in keys:
            store.put(replace(job(key), spec="x" * 20_000), Outcome(SCORES), number)
        with path.open("r+b") as file:
            # The counter of changes, without which SQLite would use the pages in its memory.
            file.seek(24)
            file.write(b"\0\0\xff\xff")
            file.seek(path.stat().st_size // 8192 * 4096)
            file.write(b"\xff" * 40_960)
        for read in (store.changed, lambda: store.outcomes(keys)):
            with pytest.raises(StoreError, match="not usable"):
                read()


def test_a_newer_format_is_refused(tmp_path) -> None:
    path = tmp_path / "results.sqlite"
    Store(path).__exit__(None, None, None)
    db = sqlite3.connect(path)
    db.execute("PRAGMA user_version = 99")
    db.close()
    with pytest.raises(StoreError, match="format 99"):
        Store(path)


def test_a_file_with_other_columns_is_named(tmp_path) -> None:
    path = tmp_path / "results.sqlite"
    Store(path).__exit__(None, None, None)
    db = sqlite3.connect(path)
    db.execute("ALTER TABLE results RENAME COLUMN scores TO marks")
    db.execute("ALTER TABLE manifests RENAME COLUMN content TO contents")
    db.close()
    with Store(path) as store:
        with pytest.raises(StoreError, match="is not usable"):
            store.outcomes(["k"])
        with pytest.raises(StoreError, match="is not usable"):
            store.begin({})


COLUMNS = (
    "key",
    "board",
    "entry",
    "scenario",
    "seed",
    "spec",
    "scores",
    "reason",
    "inputs",
    "condition",
    "log",
    "finished",
)


@pytest.mark.parametrize("column", COLUMNS)
def test_a_row_that_was_changed_does_not_count_and_is_named(tmp_path: Path, column: str) -> None:
    path = tmp_path / "results.sqlite"
    with Store(path) as store:
        number = store.begin({})
        store.put(job("k1"), Outcome(SCORES, "it broke", "a log"), number)
        store.put(job("k2"), Outcome(SCORES), number)
        changed = {"seed": 2, "scores": '{"rate": {}}', "entry": "other"}.get(column, "changed")
        db = sqlite3.connect(path)
        db.execute(f"UPDATE results SET {column} = ? WHERE key = 'k1'", (changed,))
        db.commit()
        db.close()
        entry = "other" if column == "entry" else "mine"
        with pytest.warns(UserWarning, match=rf"results\.sqlite: the row of {entry} on"):
            assert list(store.outcomes(["k1", "k2", "changed"])) == ["k2"]


@pytest.mark.parametrize("value", ["CAST(X'ff00' AS TEXT)", "X'ff00'", "NULL", "1.5"])
def test_a_column_of_another_type_does_not_count(tmp_path: Path, value: str) -> None:
    path = tmp_path / "results.sqlite"
    with Store(path) as store:
        store.put(job("k"), Outcome(SCORES, "it broke"), store.begin({}))
        db = sqlite3.connect(path)
        db.execute(f"UPDATE results SET reason = {value}")
        db.commit()
        db.close()
        with pytest.warns(UserWarning, match="the row of mine on"):
            assert store.outcomes(["k"]) == {}


def test_a_row_without_readable_scores_does_not_count(tmp_path: Path) -> None:
    class Other:
        def to_json(self) -> list[int]:
            return [1]

    with Store(tmp_path / "results.sqlite") as store:
        store.put(job("k"), Outcome({"rate": Other()}), store.begin({}))
        with pytest.warns(UserWarning, match="mine"):
            assert store.outcomes(["k"]) == {}


def test_inputs_conditions_and_the_end_of_the_log_are_kept(tmp_path: Path) -> None:
    path = tmp_path / "results.sqlite"
    row = StoredJob("k", "tracking", "mine", "motorway", 1, "{}", "oracle", "fog:3 + night:2")
    with Store(path) as store:
        log = "a" * LOG_LENGTH + "the last words"
        store.put(row, Outcome({}, "it broke", log), store.begin({}))
        assert store.outcomes(["k"])["k"] == Outcome({}, "it broke", log[-LOG_LENGTH:])
    db = sqlite3.connect(path)
    stored_rows = db.execute("SELECT inputs, condition FROM results").fetchall()
    db.close()
    assert stored_rows == [("oracle", "fog:3 + night:2")]


def test_a_path_that_cannot_be_opened(tmp_path) -> None:
    with pytest.raises(StoreError, match="cannot open"):
        Store(tmp_path)
