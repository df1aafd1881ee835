"""Constructors of plug-ins that take keyword arguments, or one record of settings."""

from dataclasses import dataclass, field

import pytest

from roadscope import ODOMETRIES, TRACKERS
from roadscope.core import SpecError, construct


@dataclass(frozen=True)
class Gate:
    """A record inside the settings."""

    gate_m: float = 2.0
    share: float = 0.9


@dataclass(frozen=True)
class Settings:
    """Settings with a record inside."""

    name: str = "one"
    gate: Gate = field(default_factory=Gate)

    def __post_init__(self) -> None:
        if self.name == "bad":
            raise ValueError("name is bad")


class TakesSettings:
    """A plug-in whose constructor takes a record."""

    def __init__(self, settings: Settings = Settings()) -> None:
        self.settings = settings


class TakesArguments:
    """A plug-in whose constructor takes arguments, one of them named settings."""

    def __init__(self, settings: Settings = Settings(), more: int = 0) -> None:
        self.settings, self.more = settings, more


def test_arguments_become_fields_of_the_settings_and_of_the_record_inside() -> None:
    made = construct(TakesSettings, {"gate_m": 5.0, "name": "two"}).settings
    assert made == Settings(name="two", gate=Gate(gate_m=5.0))
    assert construct(TakesSettings, {}).settings == Settings()


def test_settings_check_themselves() -> None:
    with pytest.raises(ValueError, match="name is bad"):
        construct(TakesSettings, {"name": "bad"})


@pytest.mark.parametrize("name", ["gate", "settings", "speed"])
def test_a_name_that_no_record_has_is_refused(name: str) -> None:
    with pytest.raises(TypeError, match=f"'{name}'"):
        construct(TakesSettings, {name: 1})


def test_a_constructor_with_more_arguments_takes_them_as_they_are() -> None:
    made = construct(TakesArguments, {"settings": Settings(name="two"), "more": 3})
    assert (made.settings.name, made.more) == ("two", 3)


def test_a_spec_names_the_fields_that_a_plug_in_takes() -> None:
    with pytest.raises(SpecError, match=r"'pmbm\?gate=2'.*its arguments: .*hypotheses=10"):
        TRACKERS.make("pmbm?gate=2")
    with pytest.raises(ValueError, match=r"hypotheses must be a whole number, got 2\.5"):
        TRACKERS.make("pmbm?hypotheses=2.5")
    assert ODOMETRIES.make("zhang2022?eps_m=0.1").clustering.eps_m == 0.1
