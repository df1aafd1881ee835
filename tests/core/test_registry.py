from collections.abc import Callable
from pathlib import Path

import pytest

from roadscope import Spec
from roadscope.benchmarks import distribution_version, plugin_hash, source_hash
from roadscope.core import NotInstalledError, Registry, Requirement, SpecError
from roadscope.trackers import TRACKERS


class Plain:
    def __init__(self, *, gate_m: float = 1.0, mode: str = "a") -> None:
        self.gate_m, self.mode = gate_m, mode


REGISTRY: Registry[Plain] = Registry(
    "tracker", {"plain": f"{__name__}:Plain", "wide": f"{__name__}:Plain?gate_m=9.0"}
)


def test_a_name_makes_its_class_and_arguments_win_over_the_alias() -> None:
    assert REGISTRY.make("plain").gate_m == 1.0
    assert REGISTRY.make("wide").gate_m == 9.0
    made = REGISTRY.make("wide?gate_m=2.5&mode=b")
    assert (made.gate_m, made.mode) == (2.5, "b")
    assert list(REGISTRY) == ["plain", "wide"]
    assert "plain" in REGISTRY
    assert not REGISTRY.resolve("plain").ours


def test_an_unknown_name_lists_what_exists_and_what_was_meant() -> None:
    with pytest.raises(
        SpecError, match=r"no tracker 'plane' \(did you mean 'plain'\?\); known: plain, wide"
    ):
        REGISTRY.make("plane")


@pytest.mark.parametrize(
    ("spec", "message"),
    [
        ("plain?gate=2", r"unexpected keyword argument 'gate'; its arguments: gate_m=1.0, "),
        ("plain?gate_m", "arguments look like name"),
        ("?x=1", "names nothing"),
        ("nowhere.at.all:Thing", "cannot import 'nowhere.at.all'"),
        ("math:Thing", "no class 'Thing' in math"),
        ("missing.py:Thing", "no file missing.py"),
        ("mine.py", "name the class in the file too: mine.py:Class"),
        (":Thing", "names no module or file"),
        ("math:", "'math:': name a class after the colon: math:Class"),
        ("math:sqrt", "'math:sqrt' is not a class"),
    ],
)
def test_a_wrong_spec_is_named(spec: str, message: str) -> None:
    with pytest.raises(SpecError, match=message):
        REGISTRY.make(spec)


def test_a_file_of_ones_own_is_a_plug_in(tmp_path: Path) -> None:
    path = tmp_path / "mine.py"
    path.write_text("class Mine:\n    def __init__(self, *, k=1):\n        self.k = k\n")
    assert REGISTRY.make(f"{path}:Mine?k=3").k == 3  # type: ignore[attr-defined]
    before = source_hash(f"{path}:Mine")
    path.write_text(path.read_text().replace("k=1", "k=2"))
    assert source_hash(f"{path}:Mine") != before
    with pytest.raises(SpecError, match=r"no class 'Other' in .*mine.py; it has: Mine"):
        REGISTRY.make(f"{path}:Other")


def test_a_file_that_fails_says_how(tmp_path: Path) -> None:
    path = tmp_path / "broken.py"
    path.write_text("1 / 0\n")
    with pytest.raises(SpecError, match=r"fails when loaded: ZeroDivisionError"):
        REGISTRY.make(f"{path}:Mine")


def test_the_line_at_which_a_module_fails_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "lacks.py").write_text("import math\nimport no_such_module\n")
    (tmp_path / "calls.py").write_text("import ast\n\nast.literal_eval('1 +')\n")
    (tmp_path / "typo.py").write_text("\n\nclass Mine\n")
    monkeypatch.syspath_prepend(tmp_path)
    for name, ends in (("lacks", "2"), ("calls", "3")):
        for spec in (f"{name}:Mine", f"{tmp_path / name}.py:Mine"):
            with pytest.raises(SpecError, match=rf" \({name}\.py:{ends}\)$"):
                REGISTRY.make(spec)
    with pytest.raises(SpecError, match=r"SyntaxError: .*\(typo\.py, line 3\)$"):
        REGISTRY.make(f"{tmp_path / 'typo'}.py:Mine")
    with pytest.raises(SpecError, match=r"^cannot import 'not_there': .*'not_there'$"):
        REGISTRY.make("not_there:Mine")


@pytest.mark.parametrize("line", ["import sys; sys.exit(4)", "raise ValueError('no')"])
def test_a_module_that_ends_the_process_or_raises_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, line: str
) -> None:
    name = f"ends_{len(line)}"
    (tmp_path / f"{name}.py").write_text(line + "\n")
    monkeypatch.syspath_prepend(tmp_path)
    for spec in (f"{name}:Thing", f"{tmp_path / name}.py:Thing"):
        with pytest.raises(SpecError, match=r"fails when loaded: (SystemExit|ValueError)"):
            REGISTRY.make(spec)


def test_classes_that_a_file_imports_are_not_offered(tmp_path: Path) -> None:
    path = tmp_path / "few.py"
    path.write_text("from pathlib import Path\n\n\nclass Own:\n    pass\n")
    with pytest.raises(SpecError, match=r"it has: Own$"):
        REGISTRY.make(f"{path}:Other")


def test_a_helper_beside_the_plug_in_counts_as_its_source(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "helper_of_mine.py").write_text("K = 1\n")
    path = tmp_path / "mine.py"
    path.write_text("import helper_of_mine\n\n\nclass Mine:\n    pass\n")
    monkeypatch.syspath_prepend(tmp_path)
    before = source_hash(f"{path}:Mine")
    (tmp_path / "unrelated.py").write_text("K = 1\n")
    assert source_hash(f"{path}:Mine") == before
    (tmp_path / "helper_of_mine.py").write_text("K = 2\n")
    assert source_hash(f"{path}:Mine") != before


def write_distribution(site: Path, name: str, version: str) -> Path:
    """Write what tells that a distribution is installed; return the folder."""
    info = site / f"{name.replace('-', '_')}-{version}.dist-info"
    info.mkdir(parents=True)
    (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name}\nVersion: {version}\n")
    return info


@pytest.mark.parametrize("distribution", ["lib_of_others", "another-name"])
def test_the_version_of_an_imported_package_counts(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, distribution: str
) -> None:
    path = tmp_path / "mine.py"
    path.write_text("import lib_of_others\n\n\nclass Mine:\n    pass\n")
    hashes = [source_hash(f"{path}:Mine")]
    for version in ("1.0", "1.1"):
        site = tmp_path / version
        info = write_distribution(site, distribution, version)
        (info / "top_level.txt").write_text("lib_of_others\n")
        monkeypatch.syspath_prepend(site)
        distribution_version.cache_clear()
        hashes.append(source_hash(f"{path}:Mine"))
    assert len(set(hashes)) == 3


def test_comments_and_docstrings_of_a_plug_in_do_not_count(tmp_path: Path) -> None:
    helper, path = tmp_path / "helper_of_mine.py", tmp_path / "mine.py"
    helper.write_text("K = 1\n")
    path.write_text("import helper_of_mine\n\n\nclass Mine:\n    pass\n")
    before = source_hash(f"{path}:Mine")
    helper.write_text("# One.\nK = 1\n")
    path.write_text('"""Mine."""\n' + path.read_text() + "# The end.\n")
    assert source_hash(f"{path}:Mine") == before
    helper.write_text("K = 1 # and what is no Python: {\n}\n")
    broken = source_hash(f"{path}:Mine")
    assert broken != before
    helper.write_text("K = 2 # and what is no Python: {\n}\n")
    assert source_hash(f"{path}:Mine") != broken


class Needy(Plain):
    requires = Requirement("no-such-distribution", "pip install no-such-distribution")


def test_what_is_not_installed_is_named_with_what_installs_it() -> None:
    registry: Registry[Plain] = Registry("tracker", {"needy": f"{__name__}:Needy"})
    reason = "no-such-distribution is not installed: pip install no-such-distribution"
    with pytest.raises(NotInstalledError, match=reason):
        registry.make("needy")
    with pytest.raises(SpecError, match="its arguments: gate_m"):
        registry.make("needy?gate=2")


def test_names_that_need_what_is_not_installed_are_known_before_they_are_made(
    uninstall: Callable[[str], None],
) -> None:
    uninstall("norfair")
    assert "norfair" in TRACKERS.names()
    assert "norfair" not in TRACKERS.installed()
    assert "nearest" in TRACKERS.installed()
    assert "norfair" in (TRACKERS.missing("norfair?distance_m=2") or "")
    assert TRACKERS.missing("nearest?gate_m=2") is None
    with pytest.raises(NotInstalledError, match="norfair is not installed"):
        TRACKERS.make("norfair")


def test_the_version_of_what_a_plug_in_of_ours_needs_counts_as_its_source(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    plugin = TRACKERS.resolve("norfair")
    assert plugin.requirement is not None
    before = plugin_hash(plugin)
    write_distribution(tmp_path, "norfair", "0")
    monkeypatch.syspath_prepend(tmp_path)
    assert plugin.requirement.version == "0"
    assert plugin_hash(plugin) != before


def test_a_resolved_spec_names_its_class_and_its_kind_and_loads_nothing() -> None:
    plugin = REGISTRY.resolve("nowhere.at.all:Thing?x=1")
    assert (plugin.kind, plugin.target, plugin.ours) == ("tracker", "nowhere.at.all:Thing", False)
    alias = REGISTRY.resolve("wide?mode=b")
    assert alias.target == f"{__name__}:Plain"
    assert alias.arguments == {"gate_m": 9.0, "mode": "b"}
    assert str(alias) == "wide?mode=b"
    assert alias.factory is Plain
    assert REGISTRY.resolve(Spec.parse("wide?mode=b")) == alias


def test_a_plug_in_of_ours_refuses_arguments_of_another_type() -> None:
    with pytest.raises(ValueError, match=r"gate_m.*'far'"):
        TRACKERS.make("nearest?gate_m=far")


def test_all_files_of_a_package_count_as_its_source(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    package = tmp_path / "package_of_mine"
    package.mkdir()
    (package / "__init__.py").write_text("")
    (package / "helper.py").write_text("K = 1\n")
    (package / "plug.py").write_text("from package_of_mine.helper import K\n\n\nclass Mine: ...\n")
    monkeypatch.syspath_prepend(tmp_path)
    before = source_hash("package_of_mine.plug:Mine")
    assert source_hash(f"{package / 'plug.py'}:Mine") != ""
    (package / "helper.py").write_text("K = 2\n")
    assert source_hash("package_of_mine.plug:Mine") != before
