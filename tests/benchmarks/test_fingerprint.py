import os
import subprocess
import sys
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from importlib.machinery import EXTENSION_SUFFIXES
from itertools import count
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from roadscope.benchmarks import (
    PACKAGE,
    code_hash,
    distribution_version,
    fingerprint,
    package,
    package_version,
    plugin_hash,
    sensing_hash,
    timeline_hash,
)
from roadscope.core import Registry, SpecError
from roadscope.detectors import DETECTORS
from roadscope.detectors.camera import CAMERA_DETECTORS
from roadscope.fusion import FUSIONS
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
        1,
        "1",
        1.5,
        None,
        True,
        [1],
        {"a": 1},
        np.arange(3),
        np.arange(3.0),
        np.zeros((3, 1)),
        np.zeros((1, 3)),
        Thing(1, np.arange(3)),
        Thing(2, np.arange(3)),
        code_hash,
    ]
    assert len({fingerprint(thing) for thing in things}) == len(things)


@pytest.mark.slow
def test_fingerprints_do_not_depend_on_the_process() -> None:
    code = (
        "import numpy as np\n"
        "from roadscope.benchmarks import fingerprint, plugin_hash, sensing_hash\n"
        "from roadscope.detectors import DETECTORS\n"
        "print(fingerprint({'b': np.arange(4), 'a': {1, }.__class__.__name__}),"
        "plugin_hash(DETECTORS.resolve('pag')), sensing_hash())"
    )
    runs = [
        subprocess.run(
            [sys.executable, "-c", code],
            capture_output=True,
            text=True,
            check=True,
            cwd=PACKAGE.parent,
            env={"PYTHONHASHSEED": seed},
        ).stdout
        for seed in ("1", "2")
    ]
    assert runs[0] == runs[1]


def test_arguments_and_class_distinguish_plug_ins() -> None:
    specs = ["pag", "distance", "distance?distance_m=0.7", "distance?split_m=0.2"]
    assert len({plugin_hash(DETECTORS.resolve(spec)) for spec in specs}) == len(specs)


def test_a_file_that_an_argument_names_counts_by_content(tmp_path) -> None:
    traits = tmp_path / "mine.toml"
    traits.write_text("one")
    plugin = TRACKERS.resolve(f"existence?traits={traits}")
    before = plugin_hash(plugin)
    traits.write_text("two")
    assert plugin_hash(plugin) != before


MINI = {
    "__init__.py": "",
    "base.py": "GAIN = 2\n",
    "middle.py": "from mini import base\n\n\ndef twice(x):\n    return base.GAIN * x\n",
    "face/__init__.py": "from mini.base import GAIN\nfrom mini.face.deep import deep\n",
    "face/deep.py": "def deep():\n    return 3\n",
    "face/plain.py": "WIDTH = 8\n",
    "lazy.py": """
from typing import TYPE_CHECKING
if TYPE_CHECKING:
    from mini.unrelated import OTHER
    from mini.late import LATE
def __getattr__(name):
    return 1
""",
    "typed.py": """
from typing import TYPE_CHECKING
if TYPE_CHECKING:
    from mini.unrelated import OTHER
SIZE = 4
""",
    "unrelated.py": "OTHER = 5\n",
    "top.py": """
from mini.middle import twice

def work(x):
    from mini.late import LATE
    return twice(x) + LATE
""",
    "late.py": "LATE = 6\n",
    "relative/__init__.py": "",
    "relative/user.py": "from ..base import GAIN\nfrom . import beside\n",
    "relative/beside.py": "NEAR = 1\n",
    "files/__init__.py": "",
    "files/reader.py": "FOLDER = 'tables'\n",
    "files/top.toml": "a = 1\n",
    "files/tables/one.json": "[1]",
    "files/other/two.json": "[2]",
    "files/notes.txt": "x",
}
"""A package of a few modules."""
HashOf = Callable[[str, Mapping[str, str]], str]


@pytest.fixture
def hash_of(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> HashOf:
    """Return what hashes one module of the small package in which some files are changed."""
    monkeypatch.setenv("ROADSCOPE_CACHE", str(tmp_path / "cache"))
    numbers = count()

    def hashed(module: str, changes: Mapping[str, str]) -> str:
        root = tmp_path / str(next(numbers)) / "mini"
        for name, text in {**MINI, **changes}.items():
            path = root / name
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(text)
        return code_hash(f"mini.{module}", root=root)

    return hashed


def test_the_version_of_a_library_counts_where_it_is_used(
    hash_of: HashOf, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    uses = {"late.py": "import filterpy\n\nLATE = 6\n"}
    before = [hash_of(module, uses) for module in ("top", "middle")]
    info = tmp_path / "filterpy-99.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: filterpy\nVersion: 99.0\n")
    monkeypatch.syspath_prepend(tmp_path)
    package_version.cache_clear()
    after = [hash_of(module, uses) for module in ("top", "middle")]
    package_version.cache_clear()
    assert [a == b for a, b in zip(before, after, strict=True)] == [False, True]


REWORDED = """
# A comment.
from mini.middle import twice

def work(x):
    \"\"\"Return it.\"\"\"
    from mini.late import LATE  # another
    return (
        twice(x) + LATE
    )
"""


@pytest.mark.parametrize(
    ("module", "file", "text"),
    [
        ("top", "top.py", REWORDED),
        ("top", "base.py", '"""Doc."""\n\nGAIN = 2\n"""What it is multiplied by."""\n'),
        ("top", "unrelated.py", "OTHER = 6\n"),
        ("top", "files/top.toml", "a = 2\n"),
        ("typed", "unrelated.py", "OTHER = 6\n"),
        ("typed", "typed.py", "SIZE = 4\n"),
        ("lazy", "lazy.py", MINI["lazy.py"]),
        ("files.reader", "files/other/two.json", "[3]"),
        ("files.reader", "files/notes.txt", "y"),
        ("files.reader", "__init__.py", "A = 1\n"),
    ],
)
def test_what_a_module_does_not_run_or_read_changes_no_hash(
    hash_of: HashOf, module: str, file: str, text: str
) -> None:
    if file == "typed.py":
        text = f"from typing import TYPE_CHECKING\n{text}"
    assert hash_of(module, {file: text}) == hash_of(module, {})


@pytest.mark.parametrize(
    ("module", "file", "text"),
    [
        ("top", "top.py", MINI["top.py"].replace("+ LATE", "- LATE")),
        ("top", "middle.py", MINI["middle.py"].replace("* x", "+ x")),
        ("top", "base.py", "GAIN = 2.0\n"),
        ("top", "late.py", "LATE = 7\n"),
        ("face", "base.py", "GAIN = 3\n"),
        ("relative.user", "base.py", "GAIN = 3\n"),
        ("relative.user", "relative/beside.py", "NEAR = 2\n"),
        ("files.reader", "files/top.toml", "a = 2\n"),
        ("files.reader", "files/tables/one.json", "[3]"),
        ("files.reader", "files/more.npz", "new"),
    ],
)
def test_what_a_module_runs_or_reads_changes_its_hash(
    hash_of: HashOf, module: str, file: str, text: str
) -> None:
    assert hash_of(module, {file: text}) != hash_of(module, {})


def test_a_module_taken_from_a_package_does_not_bring_the_packages_own_imports(
    hash_of: HashOf,
) -> None:
    user = {"user.py": "from mini.face import plain\n"}
    assert hash_of("user", {**user, "base.py": "GAIN = 3\n"}) == hash_of("user", user)
    assert hash_of("user", {**user, "face/plain.py": "WIDTH = 9\n"}) != hash_of("user", user)


def test_a_name_that_a_package_only_offers_brings_where_it_is_from(hash_of: HashOf) -> None:
    user = {"user.py": "from mini.face import deep\n"}
    assert hash_of("user", {**user, "face/deep.py": "deep = 4\n"}) != hash_of("user", user)
    assert hash_of("user", {**user, "base.py": "GAIN = 3\n"}) == hash_of("user", user)


@pytest.mark.parametrize("statement", ["WIDTH = 8\n", "import mini.base as base\n"])
def test_a_package_that_does_more_counts_with_all_that_it_imports(
    hash_of: HashOf, statement: str
) -> None:
    user = {
        "user.py": "from mini.face import deep\n",
        "face/__init__.py": MINI["face/__init__.py"] + statement,
    }
    for file in ("base.py", "face/deep.py"):
        assert hash_of("user", {**user, file: "GAIN = 3\n"}) != hash_of("user", user)


def test_a_name_that_a_module_loads_on_use_brings_where_it_is_from(hash_of: HashOf) -> None:
    user = {"user.py": "from mini.lazy import OTHER\n"}
    assert hash_of("user", {**user, "unrelated.py": "OTHER = 6\n"}) != hash_of("user", user)
    assert hash_of("user", {**user, "late.py": "LATE = 7\n"}) == hash_of("user", user)
    assert hash_of("lazy", {"unrelated.py": "OTHER = 6\n"}) == hash_of("lazy", {})


def test_unknown_modules_are_refused_by_name(hash_of: HashOf) -> None:
    with pytest.raises(ModuleNotFoundError, match=r"mini\.nothing"):
        hash_of("nothing", {})


@pytest.mark.slow
def test_a_file_that_changes_is_parsed_again_by_the_next_process(tmp_path: Path) -> None:
    root = tmp_path / "mini"
    root.mkdir()
    code = "import sys, pathlib; from roadscope.benchmarks import code_hash\n"
    code += "print(code_hash('mini.one', root=pathlib.Path(sys.argv[1])))"

    def hashed() -> str:
        return subprocess.run(
            [sys.executable, "-c", code, str(root)],
            capture_output=True,
            text=True,
            check=True,
            env={**os.environ, "ROADSCOPE_CACHE": str(tmp_path / "cache")},
        ).stdout

    hashes = []
    for text in ("A = 1\n", "A = 1\n", "A = 2\n"):
        (root / "one.py").write_text(text)
        hashes.append(hashed())
    assert hashes[0] == hashes[1] != hashes[2]
    for index in (tmp_path / "cache").rglob("*.json"):
        index.write_bytes(b"damaged")
    assert hashed() == hashes[2]


def test_traffic_does_not_depend_on_sensors_and_images() -> None:
    sources = package(PACKAGE)
    recorded = sources.closure(["roadscope.envs.traffic.scenarios"])
    assert not [
        n for n in recorded if n.startswith(("roadscope.envs.sensors", "roadscope.envs.im"))
    ]
    assert timeline_hash("motorway") != timeline_hash("cut-ins")
    assert timeline_hash("motorway") != timeline_hash()
    assert sensing_hash("motorway") != sensing_hash("cut-ins")


@pytest.mark.parametrize(
    ("registry", "spec", "data"),
    [
        (CAMERA_DETECTORS, "network", "network.safetensors"),
        (TRACKERS, "existence", "roadscope.toml"),
        (FUSIONS, "li2021", "weights.toml"),
    ],
)
def test_what_plug_ins_of_ours_have_learned_counts(
    registry: Registry[Any], spec: str, data: str
) -> None:
    sources = package(PACKAGE)
    modules = sources.closure([registry.resolve(spec).factory.__module__])
    assert data in [path.name for path in sources.data_files(modules)]


STRANGER = "from beside import GAIN\n\nraise SystemExit\n\nclass Mine:\n    pass\n"


def hash_of_tracker(text: str) -> str:
    return plugin_hash(TRACKERS.resolve(text))


@pytest.mark.parametrize("target", ["{folder}/mine.py:Mine", "strange.mine:Mine"])
def test_a_strangers_code_counts_and_is_not_run(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, target: str
) -> None:
    monkeypatch.syspath_prepend(tmp_path)
    folder = tmp_path / "strange"
    folder.mkdir()
    (folder / "__init__.py").write_text("raise SystemExit")
    (folder / "mine.py").write_text(STRANGER)
    (folder / "beside.py").write_text("GAIN = 1\n")
    target = target.format(folder=folder)
    before = hash_of_tracker(target)
    assert hash_of_tracker(f"{target}?a=1") != before
    assert hash_of_tracker(target.replace(":Mine", ":Other")) != before
    (folder / "beside.py").write_text("GAIN = 2\n")
    assert hash_of_tracker(target) != before


READER = """
from pathlib import Path
HERE = Path(__file__).parent

class Mine:
    kind = "tracker"
    def __init__(self, *, weights="beside.pt"):
        self.weights = HERE / "nets" / weights
    def reset(self):
        self.gate_m = float((HERE / "gate.txt").read_text()) + float(open("from_here.csv").read())
"""


@pytest.mark.parametrize(
    "file",
    [
        "plugins/gate.txt",
        "plugins/nets/beside.pt",
        "from_here.csv",
        "plugins/weights.zip",
        "weights.zip",
    ],
)
def test_data_that_a_strangers_code_or_arguments_name_counts(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, file: str
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "plugins" / "nets").mkdir(parents=True)
    (tmp_path / "plugins" / "mine.py").write_text(READER)
    hashes = [hash_of_tracker("plugins/mine.py:Mine?weights=weights.zip")]
    for content in ("1", "2"):
        (tmp_path / file).write_text(content)
        hashes.append(hash_of_tracker("plugins/mine.py:Mine?weights=weights.zip"))
    (tmp_path / "plugins" / "notes.txt").write_text("nobody reads this")
    hashes.append(hash_of_tracker("plugins/mine.py:Mine?weights=weights.zip"))
    assert len(set(hashes)) == 3
    assert hashes[-1] == hashes[-2]


def test_a_large_file_that_an_argument_names_counts_by_content(tmp_path: Path) -> None:
    (tmp_path / "mine.py").write_text("class Mine: ...\n")
    weights, text = tmp_path / "net.pt", f"{tmp_path / 'mine.py'}:Mine?weights=net.pt"
    weights.write_bytes(bytes(2_000_000))
    before = hash_of_tracker(text)
    assert hash_of_tracker(text) == before
    weights.write_bytes(b"1" + bytes(2_000_000))
    assert hash_of_tracker(text) != before


@pytest.mark.parametrize(
    "text", ["/", ".", "..", "./", "a" * 255, "/" + "b" * 254, "~", "\0x", "/\ud800", "\ud800"]
)
def test_texts_of_a_strangers_code_that_name_no_file_do_no_harm(tmp_path: Path, text: str) -> None:
    (tmp_path / "mine.py").write_text(f"class Mine:\n    texts = [{text!r}, '', '/proc/stat']\n")
    plugin = f"{tmp_path / 'mine.py'}:Mine"
    assert hash_of_tracker(plugin) == hash_of_tracker(plugin)


@pytest.mark.parametrize(
    "line",
    [
        'open("notes.txt", "a").write("x")',
        'open("notes.txt", mode="w")',
        'Path("notes.txt").open("ab")',
        'Path("notes.txt").write_text("x")',
        'log = "notes.log"',
        'log = "notes"',
    ],
)
def test_what_a_plug_in_writes_does_not_count(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, line: str
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "mine.py").write_text(f"class Mine:\n    def reset(self):\n        {line}\n")
    before = hash_of_tracker("mine.py:Mine?log=mine.log")
    for name in ("notes.txt", "notes.log", "notes", "mine.log"):
        (tmp_path / name).write_text("written")
    assert hash_of_tracker("mine.py:Mine?log=mine.log") == before


def test_a_link_or_a_folder_that_is_called_like_a_source_does_no_harm(tmp_path: Path) -> None:
    for name in ("__init__.py", "mine.py"):
        (tmp_path / name).write_text("class Mine: ...\n")
    (tmp_path / ".#mine.py").symlink_to("nowhere")
    (tmp_path / "folder.py").mkdir()
    plugin = f"{tmp_path / 'mine.py'}:Mine"
    assert hash_of_tracker(plugin) == hash_of_tracker(plugin)


def test_a_file_named_like_a_package_does_not_hide_its_version(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    installed = tmp_path / "installed"
    about = installed / "lib_of_others-1.dist-info"
    (installed / "lib_of_others").mkdir(parents=True)
    (installed / "lib_of_others" / "__init__.py").write_text("A = 1\n")
    about.mkdir()
    (about / "METADATA").write_text("Metadata-Version: 2.1\nName: lib_of_others\nVersion: 1\n")
    monkeypatch.syspath_prepend(installed)
    backends = tmp_path / "mine" / "backends"
    backends.mkdir(parents=True)
    for folder in (backends.parent, backends):
        (folder / "__init__.py").write_text("")
    (backends / "base.py").write_text("import lib_of_others\n")
    (backends / "lib_of_others.py").write_text("B = 1\n")
    (backends.parent / "mine.py").write_text("class Mine: ...\n")
    plugin = f"{backends.parent / 'mine.py'}:Mine"

    def hashed() -> str:
        distribution_version.cache_clear()
        return hash_of_tracker(plugin)

    before = hashed()
    # It counts by its version alone.
    (installed / "lib_of_others" / "__init__.py").write_text("A = 2\n")
    assert hashed() == before
    (about / "METADATA").write_text("Metadata-Version: 2.1\nName: lib_of_others\nVersion: 2\n")
    assert hashed() != before


@pytest.mark.parametrize(
    "changed",
    [
        "plugins/parts/deep.py",
        "plugins/common_of_mine.py",
        "plugins/fast_of_mine{suffix}",
        "plugins/parts/quick{suffix}",
        "lab/shared_of_mine/core.py",
    ],
)
def test_all_code_of_ones_own_that_a_plug_in_imports_counts(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, changed: str
) -> None:
    files = {
        "plugins/mine.py": "import parts.deep\n\n\nclass Mine: ...\n",
        "plugins/parts/__init__.py": "",
        "plugins/parts/deep.py": "import common_of_mine, fast_of_mine\nfrom . import quick\n",
        "plugins/common_of_mine.py": "from shared_of_mine import core\n",
        "plugins/fast_of_mine{suffix}": "1",
        "plugins/parts/quick{suffix}": "1",
        "lab/shared_of_mine/__init__.py": "",
        "lab/shared_of_mine/core.py": "GAIN = 1\n",
    }
    for name, content in files.items():
        path = tmp_path / name.format(suffix=EXTENSION_SUFFIXES[0])
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(content)
    monkeypatch.syspath_prepend(tmp_path / "lab")
    before = hash_of_tracker(f"{tmp_path}/plugins/mine.py:Mine")
    path = tmp_path / changed.format(suffix=EXTENSION_SUFFIXES[0])
    path.write_text(files[changed] + "2")
    assert hash_of_tracker(f"{tmp_path}/plugins/mine.py:Mine") != before


def test_modules_beside_an_installed_plug_in_count_by_their_versions(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    site = tmp_path / "site-packages"
    (site / "large_of_others").mkdir(parents=True)
    (site / "large_of_others" / "__init__.py").write_text("")
    (site / "plug_of_mine.py").write_text("import large_of_others\n\n\nclass Mine: ...\n")
    monkeypatch.syspath_prepend(site)
    before = hash_of_tracker("plug_of_mine:Mine")
    (site / "large_of_others" / "__init__.py").write_text("GAIN = 1\n")
    assert hash_of_tracker("plug_of_mine:Mine") == before


def test_a_stranger_that_does_not_exist_is_refused() -> None:
    for target in ("no/such/file.py:Mine", "no_such_module:Mine"):
        with pytest.raises(SpecError, match="no file or module"):
            hash_of_tracker(target)


def test_ours_by_target_count_by_what_they_import() -> None:
    targets = ["roadscope.trackers._nearest:NearestTracker", "roadscope.trackers._gnn:GnnTracker"]
    hashes = [hash_of_tracker(target) for target in targets]
    assert hashes == [hash_of_tracker("nearest"), hash_of_tracker("gnn")]
    assert hashes[0] != hashes[1]


def test_missing_packages_have_no_version() -> None:
    assert package_version("no-such-package-at-all") == "not installed"
    assert package_version("numpy") == np.__version__
