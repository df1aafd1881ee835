"""Promises that plug-ins of several kinds make."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

from roadscope.benchmarks.kinds import traits_of
from roadscope.core import Spec
from roadscope.testing.subject import Instance, Promise, PromiseError, Subject

Run = Callable[[Instance], object]
"""Runs a started instance over a scene and returns its checked answers."""


def start_promises(
    method: str, signature: str, resets: Sequence[tuple[Any, ...]] = ((),)
) -> tuple[Promise, ...]:
    """Return the first promises of every plug-in: it can be made, and it has its methods.

    method: the method that the benchmark calls. signature: its parameters, for error messages.
    resets: the arguments of each call of `reset` that is tried.
    """

    def has_methods(subject: Subject) -> str:
        for name, parameters in (("reset", "self"), (method, f"self, {signature}")):
            if name not in subject.traits.methods:
                raise PromiseError(
                    f"there is no method {name}; the contract has def {name}({parameters})"
                )
        with subject.opened() as instance:
            for arguments in resets:
                instance.call("reset", *arguments)
        return ""

    return (
        Promise("can be made without arguments", made_without_arguments),
        Promise(f"has reset and {method}", has_methods),
    )


def made_without_arguments(subject: Subject) -> str:
    """Refuse a constructor with arguments that have no default or can be given by position."""
    spec = subject.kind.registry.resolve(Spec.parse(subject.spec.name))
    traits = traits_of(spec)
    if traits.problem:
        raise PromiseError(f"{traits.problem}; give every argument of the constructor a default")
    if traits.positional:
        names = ", ".join(traits.positional)
        raise PromiseError(
            f"arguments of the constructor can be given by position: {names}; put * before them: "
            f"def __init__(self, *, {names})"
        )
    with subject.opened():
        pass
    return f"arguments: {', '.join(traits.parameters)}" if traits.parameters else ""


def input_promise(run: Run) -> Promise:
    """Return the promise that no argument of a call is changed."""

    def verify(subject: Subject) -> str:
        with subject.started(watch_arguments=True) as instance:
            run(instance)
        return ""

    return Promise("leaves its input alone", verify)


def memory_promises(run: Run, run_other: Run, *, inputs: str, answers: str) -> tuple[Promise, ...]:
    """Return the promises that answers depend on nothing but the inputs since the last reset.

    run, run_other: answer a scene, and another one. inputs, answers: names of both in the plural.
    """

    def repeats(subject: Subject) -> str:
        runs = []
        for _ in range(2):
            with subject.started() as instance:
                runs.append(run(instance))
        if runs[0] != runs[1]:
            raise PromiseError(f"the same {inputs} give other {answers} the second time")
        return ""

    def forgets(subject: Subject) -> str:
        with subject.started() as instance:
            fresh = run(instance)
        with subject.started() as instance:
            run_other(instance)
            instance.call("reset")
            after = run(instance)
        if fresh != after:
            raise PromiseError(
                f"reset does not forget: after another scene the same {inputs} give other {answers}"
            )
        return ""

    return (
        Promise(f"gives the same {answers} for the same {inputs}", repeats),
        Promise("forgets everything at a reset", forgets),
    )


def figure_in_words(
    figure: str, value: float, *, beside: Mapping[str, float], unit: str = ""
) -> str:
    """Return a figure as one line of text; in brackets those of methods of ours and of marks."""
    others = ", ".join(f"{name}: {other:.2f}{unit}" for name, other in beside.items())
    return f"{figure} {value:.2f}{unit} ({others})"
