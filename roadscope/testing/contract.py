"""Checks the promises of a plug-in: all of them for a report, or one by one in a test suite."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from importlib import import_module
from importlib.util import find_spec

from roadscope.benchmarks.boards import plugin_kinds
from roadscope.benchmarks.isolation import Limits, PluginError, probing
from roadscope.benchmarks.kinds import TRACKER, Kind, entry_kind, traits_of
from roadscope.benchmarks.noisy import NOISES
from roadscope.benchmarks.noisy_camera import CAMERA_NOISES
from roadscope.benchmarks.noisy_odometry import ODOMETRY_NOISES
from roadscope.core import Spec, SpecError
from roadscope.core.answers import AnswerError
from roadscope.core.names import unknown
from roadscope.core.spec import FUSED, ORACLE
from roadscope.core.text import one_line
from roadscope.testing.shared import start_promises
from roadscope.testing.subject import DEADLINE_S, Promise, PromiseError, Subject

LOADED = "can be loaded"
QUIET = "prints nothing"
"""Promises beside those of the kind: the first and the last item of a report."""
SAME_REASON = "for the same reason as above"
"""The remark of an item that is wrong for the same reason as an earlier one."""
WARNING = re.compile(r"^.*:\d+: \w*Warning: .*\n(?:  .*\n?)?", re.MULTILINE)
"""A printed warning of Python and its line of code."""
OUR_REPORT = re.compile(
    r"^(?:Traceback \(most recent call last\)|Fatal Python error:)", re.MULTILINE
)
"""How the report of an error begins that the harness prints in the plug-in's process; it does not
count as output of the plug-in."""
MOST_SHOWN_CHARACTERS = 60
"""Most characters that a report shows of what a plug-in printed; chosen by hand."""


@dataclass(frozen=True, slots=True)
class Item:
    """The result of checking one promise.

    remark: what is wrong, or a figure if the promise is kept; may be empty.
    """

    promise: str
    good: bool
    remark: str = ""

    def __str__(self) -> str:
        mark = "ok   " if self.good else "WRONG"
        return f"{mark}  {self.promise}" + (f": {self.remark}" if self.remark else "")


@dataclass(frozen=True, slots=True)
class Report:
    """The results of checking all promises of a plug-in.

    kind: of the plug-in, empty if it could not be loaded.
    """

    spec: str
    kind: str
    items: tuple[Item, ...]

    @property
    def ok(self) -> bool:
        """Whether all promises are kept."""
        return not self.broken

    @property
    def broken(self) -> tuple[Item, ...]:
        """The promises that are not kept."""
        return tuple(item for item in self.items if not item.good)

    @property
    def verdict(self) -> str:
        """How many promises are broken, in one line."""
        count = len(self.broken)
        wrong = f"{count} {'item' if count == 1 else 'items'} wrong"
        return f"{self.spec}: {wrong if count else 'all right'}"

    def __str__(self) -> str:
        return "\n".join([*map(str, self.items), self.verdict])


@dataclass(frozen=True, slots=True)
class ContractItem:
    """One promise of one plug-in, for a test suite.

    spec: the resolved spec of the plug-in. deadline_s, trust: as in `check`.
    """

    spec: Spec
    kind: Kind
    promise: Promise
    deadline_s: float = DEADLINE_S
    trust: bool = False

    def __str__(self) -> str:
        return f"{self.spec} {self.promise.words}"

    def verify(self) -> str:
        """Check the promise and return a remark; `PromiseError` says what is wrong."""
        subject = Subject(self.spec, self.kind, deadline_s=self.deadline_s, trust=self.trust)
        with subject.options.probing():
            return _verify(self.promise, subject)


def contract_items(
    spec: str, *, kind: str | None = None, deadline_s: float = DEADLINE_S, trust: bool = False
) -> list[ContractItem]:
    """Return all promises of a plug-in; `SpecError` if it cannot be loaded.

    Arguments are those of `check`.
    """
    with probing(Limits(first_call_s=deadline_s), trust=trust):
        plugin, resolved_kind = _resolved(spec, kind)
        promises = _promises(plugin, resolved_kind)
    return [ContractItem(plugin, resolved_kind, promise, deadline_s, trust) for promise in promises]


def check(
    spec: str,
    *,
    kind: str | None = None,
    deadline_s: float = DEADLINE_S,
    trust: bool = False,
    sandbox: bool = False,
    report: Callable[[Item], object] | None = None,
) -> Report:
    """Check everything that a plug-in promises and return the results.

    spec: a registered name, `module:Class` or `path/to/file.py:Class`, with arguments if you like.
    kind: detector, camera detector, tracker, fusion, odometry or driver. None: the attribute `kind`
        of the class, or else the only kind whose method it has.
    deadline_s: most seconds for one promise, loading and all calls together. A plug-in that takes
        longer counts as hanging, and no more promises are checked.
    trust: run a class that is not part of roadscope in this process, where nothing ends it if it
        hangs.
    sandbox: hide network, cache and results from such a class, and let it write no file.
    report: called with each item as soon as it is checked.
    """
    if kind is not None:
        _kind_named(kind)
    items: list[Item] = []
    logs: list[str] = []

    def add(item: Item) -> None:
        items.append(item)
        if report is not None:
            report(item)

    with probing(Limits(first_call_s=deadline_s), sandbox=sandbox, trust=trust):
        try:
            plugin, resolved_kind = _resolved(spec, kind)
            promises = _promises(plugin, resolved_kind)
        except SpecError as error:
            add(Item(LOADED, False, str(error)))
            return Report(spec, "", tuple(items))
        add(Item(LOADED, True, _kind_in_words(plugin, resolved_kind)))
        earlier_remarks: set[str] = set()
        for number, promise in enumerate(promises):
            subject = Subject(
                plugin, resolved_kind, deadline_s=deadline_s, trust=trust, sandbox=sandbox
            )
            item = _item(promise, subject)
            if item.good:
                logs += subject.logs
            else:
                logs += [OUR_REPORT.split(log, 1)[0] for log in subject.logs]
            is_same = not item.good and item.remark in earlier_remarks
            earlier_remarks.add(item.remark)
            add(Item(item.promise, False, SAME_REASON) if is_same else item)
            # The first two are those of `start_promises`. If one of them is broken, or if the
            # plug-in hangs, all others are broken too.
            if not item.good and (number < 2 or subject.hangs):
                break
        add(_quiet("".join(logs)))
        return Report(spec, resolved_kind.name, tuple(items))


def _item(promise: Promise, subject: Subject) -> Item:
    try:
        return Item(promise.words, True, _verify(promise, subject))
    except PromiseError as error:
        return Item(promise.words, False, str(error))


def _verify(promise: Promise, subject: Subject) -> str:
    """Check a promise and return a remark; whatever is wrong raises `PromiseError`."""
    try:
        return promise.verify(subject)
    except (AnswerError, SpecError) as error:
        raise PromiseError(str(error)) from error
    except PluginError as error:
        text = str(error).removeprefix(f"{subject.spec}: ")
        if subject.hangs and "hangs" not in text:
            text += ": it hangs"
        raise PromiseError(text) from error


def _resolved(text: str, kind: str | None) -> tuple[Spec, Kind]:
    """Return the resolved spec of a plug-in and its kind; `SpecError` if it is no plug-in."""
    spec = Spec.parse(text).plain
    if spec.name == FUSED:
        raise SpecError(f"'{text}' joins two detectors by a fusion; check each of the three")
    registries = (NOISES, CAMERA_NOISES, ODOMETRY_NOISES)
    if spec.name == ORACLE or any(spec.name in registry for registry in registries):
        raise SpecError(f"'{text}' is made from the truth: it is no plug-in and has no contract")
    if kind is not None:
        resolved_kind = _kind_named(kind)
    else:
        resolved_kind = entry_kind(spec, tuple(plugin_kinds().values()))
    plugin = resolved_kind.registry.resolve(spec)
    if failure := traits_of(plugin).failure:
        raise SpecError(failure)
    return plugin, resolved_kind


def _kind_named(kind: str) -> Kind:
    name, kinds = kind.replace("-", " "), plugin_kinds()
    if name not in kinds:
        raise SpecError(unknown("kind", kind, kinds))
    return kinds[name]


def _promises(spec: Spec, kind: Kind) -> Sequence[Promise]:
    """Return the promises of a kind; without a module of its name, those of every plug-in."""
    if not _has_own_promises(kind):
        return start_promises(kind.method, "...")
    module = import_module(_module_of(kind))
    promises: Sequence[Promise] = module.PROMISES
    return (*promises, *module.OFFLINE_PROMISES) if _is_offline(spec, kind) else promises


def _has_own_promises(kind: Kind) -> bool:
    """Return whether this package has a module for a kind; it has none for kinds of others."""
    return find_spec(_module_of(kind)) is not None


def _module_of(kind: Kind) -> str:
    return f"{__package__}.{kind.name.replace(' ', '_')}"


def _kind_in_words(spec: Spec, kind: Kind) -> str:
    if _is_offline(spec, kind):
        return "an offline tracker"
    if not _has_own_promises(kind):
        return f"{kind}; what {kind.plural} promise beyond these items is not known"
    return str(kind)


def _is_offline(spec: Spec, kind: Kind) -> bool:
    return kind is TRACKER and traits_of(spec).offline


def _quiet(printed: str) -> Item:
    """Check that a plug-in printed nothing but warnings of Python."""
    text = WARNING.sub("", printed).strip()
    if not text:
        return Item(QUIET, True)
    first = one_line(text.splitlines()[0])[:MOST_SHOWN_CHARACTERS]
    return Item(QUIET, False, f"it prints '{first}'; use logging below the level WARNING")
