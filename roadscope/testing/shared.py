"""Promises that plug-ins of several kinds make."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

from roadscope.benchmarks.kinds import traits_of
from roadscope.testing.subject import Instance, Promise, PromiseError, Subject, resolved

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
    traits = traits_of(resolved(subject.spec.name, subject.kind))
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


@dataclass(frozen=True, slots=True)
class Words:
    """Names of what a kind of plug-in gets and answers, in the plural, for messages."""

    inputs: str
    answers: str


def memory_promises(run: Run, run_other: Run, words: Words) -> tuple[Promise, ...]:
    """Return the promises that answers depend on nothing but the inputs since the last reset.

    run, run_other: answer a scene, and another one.
    """

    def repeats(subject: Subject) -> str:
        answers = []
        for _ in range(2):
            with subject.started() as instance:
                answers.append(run(instance))
        if answers[0] != answers[1]:
            raise PromiseError(
                f"the same {words.inputs} give other {words.answers} the second time"
            )
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
                f"reset does not forget: after another scene the same {words.inputs} give other "
                f"{words.answers}"
            )
        return ""

    return (
        Promise(f"gives the same {words.answers} for the same {words.inputs}", repeats),
        Promise("forgets everything at a reset", forgets),
    )


@dataclass(frozen=True, slots=True)
class Standard:
    """The figure of a method of roadscope or of a mark, with which a plug-in's is compared."""

    name: str
    value: float


def figure_in_words(
    figure: str, value: float, *, beside: Sequence[Standard], unit: str = ""
) -> str:
    """Return a figure with others in brackets, as one line of text."""
    others = ", ".join(f"{each.name}: {each.value:.2f}{unit}" for each in beside)
    return f"{figure} {value:.2f}{unit} ({others})"
