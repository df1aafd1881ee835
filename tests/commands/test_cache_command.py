import json
from pathlib import Path

import pytest

from roadscope.benchmarks import cache_folder, cache_usage, clear_cache, size_text

DIGEST = "0123456789abcdef"
OURS = {
    "timelines": f"timelines/motorway-3-{DIGEST}.cache",
    "detections": f"detections/{DIGEST}.cache",
    "image-detections": f"image-detections/{DIGEST}.cache",
    "poses": f"poses/{DIGEST}.cache",
    "fusions": f"fusions/{DIGEST}.cache",
    "tracks": f"tracks/{DIGEST}.cache",
    "answers": f"answers/{DIGEST}.cache",
    "papers": f"papers/lu2018-{DIGEST}.cache",
    "sources": f"sources/{DIGEST}.json",
    "camera-training": f"camera-training/street-1-{DIGEST}.npy",
    "pages": "report.html",
    "results": "results.sqlite",
}
FOREIGN = (
    "notes.txt",
    "timelines/notes.txt",
    "timelines/mine.npz",
    "detections/boxes.npz",
    "mine/0123456789abcdef.npz",
    "timelines/deep/0123456789abcdef.npz",
    "other.sqlite",
)


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    place = tmp_path / "cache"
    for k, name in enumerate((*OURS.values(), *FOREIGN)):
        (place / name).parent.mkdir(parents=True, exist_ok=True)
        (place / name).write_bytes(b"x" * (k + 1))
    monkeypatch.setenv("ROADSCOPE_CACHE", str(place))
    return place


def names(folder: Path) -> set[str]:
    return {str(p.relative_to(folder)) for p in folder.rglob("*") if p.is_file()}


def test_usage_by_kind(folder: Path) -> None:
    usages = {usage.kind: usage for usage in cache_usage()}
    assert set(usages) == set(OURS)
    assert all(usage.files == 1 for usage in usages.values())
    assert usages["timelines"].size_bytes == 1
    assert usages["results"].size_bytes == len(OURS)


@pytest.mark.parametrize("kind", ["timelines", "sources"])
def test_clear_removes_files_that_a_stopped_process_has_not_finished(
    folder: Path, kind: str
) -> None:
    (folder / kind / f"{DIGEST}k_3xq1zz.part").write_bytes(b"half")
    (removed,) = clear_cache([kind])
    assert removed.files == 2


def test_clear_removes_ours_alone_and_keeps_results(folder: Path) -> None:
    removed = clear_cache()
    assert sum(usage.files for usage in removed) == len(OURS) - 1
    assert names(folder) == {*FOREIGN, OURS["results"]}
    assert sum(usage.files for usage in clear_cache()) == 0


def test_one_kind_alone(folder: Path) -> None:
    (removed,) = clear_cache(["poses"])
    assert (removed.kind, removed.files, removed.size_bytes) == ("poses", 1, 4)
    assert names(folder) == {*FOREIGN, *OURS.values()} - {OURS["poses"]}


def test_results_have_to_be_said(folder: Path) -> None:
    with pytest.raises(ValueError, match="--results"):
        clear_cache(["results"])
    assert (folder / "results.sqlite").exists()
    clear_cache(["results"], results=True)
    assert names(folder) == {*FOREIGN, *OURS.values()} - {"results.sqlite"}
    with pytest.raises(ValueError, match=r"no kind of cached files 'pose'.*did you mean 'poses'"):
        clear_cache(["pose"])


def test_links_are_not_followed(tmp_path: Path, monkeypatch) -> None:
    elsewhere, cache = tmp_path / "elsewhere", tmp_path / "linked"
    monkeypatch.setenv("ROADSCOPE_CACHE", str(cache))
    (elsewhere / "poses").mkdir(parents=True)
    cache.mkdir()
    precious = elsewhere / "poses" / f"{DIGEST}.cache"
    precious.write_bytes(b"x")
    (cache / "poses").symlink_to(elsewhere / "poses")
    (cache / "detections").mkdir()
    (cache / "detections" / f"{DIGEST}.cache").symlink_to(precious)
    assert not any(usage.files for usage in clear_cache(results=True))
    assert precious.exists()


def test_the_command(folder: Path, answer) -> None:
    assert answer("cache", "path") == (0, f"{folder}\n", "")
    table = json.loads(answer("cache", "show", "--json")[1])
    assert {kind["kind"]: kind["files"] for kind in table["kinds"]} == dict.fromkeys(OURS, 1)
    status, output, _ = answer("cache", "clear", "--kind", "poses", "--kind", "timelines")
    assert status == 0
    assert "poses" in output
    assert "timelines" in output
    assert "image-detections" not in output
    status, output, _ = answer("cache", "clear", "--results")
    assert status == 0
    assert "results" in output
    assert names(folder) == set(FOREIGN)
    assert json.loads(answer("cache", "clear", "--json")[1])["kinds"] == []
    assert answer("cache", "clear", "--quiet") == (0, "", "")
    status, _, errors = answer("cache", "clear", "--kind", "nothing")
    assert status == 1
    assert "no kind of cached files" in errors


def test_a_folder_that_is_not_there_holds_nothing(tmp_path: Path, monkeypatch) -> None:
    monkeypatch.setenv("ROADSCOPE_CACHE", str(tmp_path / "none"))
    assert cache_folder() == tmp_path / "none"
    assert not any(usage.files for usage in (*cache_usage(), *clear_cache()))
    assert not (tmp_path / "none").exists()


@pytest.mark.parametrize(
    ("size", "text"),
    [(0, "0 B"), (999, "999 B"), (1500, "1.5 kB"), (2_340_000_000_000, "2340.0 GB")],
)
def test_sizes(size: int, text: str) -> None:
    assert size_text(size) == text
