import subprocess
import sys
from dataclasses import dataclass

import numpy as np
import pytest

from roadscope.benchmarks import fingerprint as module
from roadscope.benchmarks.fingerprint import code_hash, fingerprint, package_version, plugin_hash
from roadscope.detectors import DETECTORS
from roadscope.trackers import TRACKERS


@dataclass
class Thing:
    a: int
    b: np.ndarray


def test_equal_content_has_equal_fingerprints() -> None:
    assert fingerprint({"a": 1, "b": 2}) == fingerprint({"b": 2, "a": 1})
    assert fingerprint(Thing(1, np.arange(3))) == fingerprint(Thing(1, np.arange(3)))
    assert fingerprint((1, 2)) == fingerprint([1, 2])


def test_other_content_has_other_fingerprints() -> None:
    things = [
        1, "1", 1.5, None, True, [1], {"a": 1}, np.arange(3), np.arange(3.0), np.zeros((3, 1)),
        np.zeros((1, 3)), Thing(1, np.arange(3)), Thing(2, np.arange(3)), code_hash,
    ]  # fmt: skip
    assert len({fingerprint(thing) for thing in things}) == len(things)


def test_fingerprints_do_not_depend_on_the_process() -> None:
    code = (
        "import numpy as np; from roadscope.benchmarks.fingerprint import *\n"
        "from roadscope.detectors import DETECTORS\n"
        "print(fingerprint({'b': np.arange(4), 'a': {1, }.__class__.__name__}),"
        "plugin_hash(DETECTORS.resolve('pag')), sensing_hash())"
    )
    runs = [
        subprocess.run(
            [sys.executable, "-c", code], capture_output=True, text=True, check=True,
            cwd=module.PACKAGE.parent, env={"PYTHONHASHSEED": seed},
        ).stdout
        for seed in ("1", "2")
    ]  # fmt: skip
    assert runs[0] == runs[1]


def test_arguments_and_class_tell_plug_ins_apart() -> None:
    specs = ["pag", "distance", "distance?distance_m=0.7", "distance?split_m=0.2"]
    assert len({plugin_hash(DETECTORS.resolve(spec)) for spec in specs}) == len(specs)


def test_a_file_that_an_argument_names_counts_by_content(tmp_path) -> None:
    traits = tmp_path / "mine.toml"
    traits.write_text("one")
    plugin = TRACKERS.resolve(f"existence?traits={traits}")
    before = plugin_hash(plugin)
    traits.write_text("two")
    assert plugin_hash(plugin) != before


def test_code_is_hashed_file_by_file(tmp_path, monkeypatch) -> None:
    monkeypatch.setattr(module, "PACKAGE", tmp_path)
    (tmp_path / "room").mkdir()
    (tmp_path / "room" / "a.py").write_text("a")
    (tmp_path / "room" / "b.py").write_text("b")
    plain = code_hash.__wrapped__
    whole, one = plain("room"), plain("room/a.py")
    (tmp_path / "room" / "b.py").write_text("changed")
    assert plain("room") != whole
    assert plain("room/a.py") == one


def test_no_room_is_hashed_as_nothing() -> None:
    with pytest.raises(FileNotFoundError, match=r"no source file .*benchmarks/jb"):
        code_hash("core", "benchmarks/jb.py")


def test_missing_packages_have_no_version() -> None:
    assert package_version("no-such-package-at-all") == "not installed"
    assert package_version("numpy") == np.__version__
