import math
import sqlite3

import pytest

from roadscope.benchmarks.jobs.store import Outcome, Store, StoredJob, StoreError
from roadscope.benchmarks.metrics.score import Score, ratio, rms

SCORES = {
    "rate": ratio(3, 4),
    "error": rms(2.0, 3, "m"),
    "none": Score(math.nan, "1", "higher", 0, -math.inf, 1.0),
}


def job(key: str) -> StoredJob:
    return StoredJob(key, "detection", "mine", "motorway", 1, "{}")


def test_what_is_put_is_found_again_by_another_reader(tmp_path) -> None:
    path = tmp_path / "results.sqlite"
    with Store(path) as store:
        number = store.begin({"a": 1})
        store.put(job("k1"), Outcome(SCORES), number)
        store.put(job("k2"), Outcome({}, "it broke"), number)
        with Store(path) as reader:
            found = reader.outcomes(["k1", "k2", "k3"])
    assert set(found) == {"k1", "k2"}
    assert found["k2"].reason == "it broke"
    assert found["k1"].scores["rate"] == SCORES["rate"]
    assert found["k1"].scores["error"] == SCORES["error"]
    assert math.isnan(found["k1"].scores["none"].value)
    assert found["k1"].scores["none"].least == -math.inf


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


def test_a_row_that_cannot_be_read_is_not_known(tmp_path) -> None:
    path = tmp_path / "results.sqlite"
    with Store(path) as store:
        number = store.begin({})
        store.put(job("k1"), Outcome(SCORES), number)
        store.put(job("k2"), Outcome(SCORES), number)
        db = sqlite3.connect(path)
        db.execute("UPDATE results SET scores = '{' WHERE key = 'k1'")
        db.commit()
        db.close()
        assert list(store.outcomes(["k1", "k2"])) == ["k2"]


def test_a_path_that_cannot_be_opened(tmp_path) -> None:
    with pytest.raises(StoreError, match="cannot open"):
        Store(tmp_path)
