import csv
import io
import json

import pytest

from roadscope.benchmarks.cache import FolderError
from roadscope.benchmarks.export import check_targets, save_all, to_csv, to_markdown
from roadscope.benchmarks.results import Results, Row

ROWS = (
    Row("detection", "mine|yours", "f1", 0.5, 0.4, 0.6, 9, "1", "higher"),
    Row("detection", "mine|yours", "call_p50_ms", None, None, None, 0, "ms", "lower"),
)
RESULTS = Results({"suite": "tiny"}, ROWS, ())


def test_csv_has_a_line_for_each_row() -> None:
    lines = list(csv.DictReader(io.StringIO(to_csv(RESULTS))))
    assert [line["metric"] for line in lines] == ["f1", "call_p50_ms"]
    assert float(lines[0]["value"]) == 0.5
    assert lines[1]["value"] == ""


def test_markdown_has_a_row_for_each_entry() -> None:
    text = to_markdown(RESULTS)
    assert "| mine\\|yours | 0.50 [.40, .60] |" in text
    assert len({line.replace("\\|", "").count("|") for line in text.splitlines()[2:]}) == 1


def test_all_files_are_written(tmp_path) -> None:
    paths = save_all(RESULTS, tmp_path)
    assert [path.suffix for path in paths] == [".json", ".csv", ".md"]
    assert json.loads(paths[0].read_text())["rows"][1]["value"] is None


def test_a_folder_in_the_way_is_named(tmp_path) -> None:
    check_targets(tmp_path)
    (tmp_path / "leaderboard.csv").mkdir()
    with pytest.raises(FolderError, match=r"leaderboard\.csv: it is a folder"):
        check_targets(tmp_path)
