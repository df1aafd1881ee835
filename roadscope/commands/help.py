"""Help in groups, and commands that are imported when they are called or asked for their help.

Typer draws groups only through rich, which costs twice the processor time.
"""

from __future__ import annotations

import inspect
import sys
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from importlib import import_module
from typing import Any

import typer
from typer.core import TyperCommand, TyperGroup

MAIN = "Options"
"""Heading of options that belong to no other group: those used most."""


@dataclass(frozen=True, slots=True)
class CommandEntry:
    """A command, before it is imported.

    place: `module:function` in `roadscope.commands`; the function may also be a `typer.Typer`.
    summary: what `roadscope --help` says of it, one line of at most 60 characters.
    group: its heading there.
    examples: lines for a shell that work as they are, after those of earlier commands.
    """

    place: str
    summary: str
    group: str
    examples: tuple[str, ...]

    def load(self, name: str) -> Any:
        """Import the command and return it as Typer runs it."""
        module, _, function = self.place.partition(":")
        loaded = getattr(import_module(f"roadscope.commands.{module}"), function)
        if isinstance(loaded, typer.Typer):
            command: Any = typer.main.get_command(loaded)
        else:
            alone = typer.Typer(add_completion=False, rich_markup_mode=None)
            text = _paragraphs(loaded.__doc__ or "")
            alone.command(name, cls=RegisteringCommand, help=text)(loaded)
            command = typer.main.get_command(alone)
        command.examples = self.examples
        return command


class _Commands(Mapping[str, Any]):
    """Commands by name, each imported when it is asked for."""

    def __init__(self, entries: Mapping[str, CommandEntry]) -> None:
        self.entries = entries

    def __getitem__(self, name: str) -> Any:
        return self.entries[name].load(name)

    def __iter__(self) -> Iterator[str]:
        return iter(self.entries)

    def __len__(self) -> int:
        return len(self.entries)


class _Help:
    """Help with the options in groups, then the examples, each on a line of its own."""

    examples: Sequence[str] = ()

    def format_options(self: Any, ctx: Any, formatter: Any) -> None:
        """Write arguments, then the options of each group; `--help` itself is left out."""
        groups: dict[str, list[tuple[str, str]]] = {}
        for param in self.get_params(ctx):
            if param.name != "help" and (record := param.get_help_record(ctx)) is not None:
                usual = "Arguments" if param.param_type_name == "argument" else MAIN
                group = groups.setdefault(param.rich_help_panel or usual, [])
                group.append((record[0], param.help + _default(param)))
        _write_groups(formatter, groups)

    def format_epilog(self: Any, ctx: Any, formatter: Any) -> None:
        """Write the examples, unbroken, so that they can be copied."""
        if self.examples:
            formatter.write(f"\n{_heading('Examples')}:\n")
            formatter.write("".join(f"  {line}\n" for line in self.examples))


class GroupedCommand(_Help, TyperCommand):
    """A command whose help shows options in groups."""


class RegisteringCommand(GroupedCommand):
    """A command, before which the Gymnasium ids are registered: `--help` does without Gymnasium."""

    def invoke(self, ctx: Any) -> Any:
        """Register the ids, then run the command."""
        from roadscope.envs.gym.registration import register

        register()
        return super().invoke(ctx)


class GroupedCommands(_Help, TyperGroup):
    """The commands of a table, listed in groups without importing them."""

    entries: Mapping[str, CommandEntry] = {}

    def __init__(self, **settings: Any) -> None:
        super().__init__(**settings)
        if self.entries:
            lazy: Any = _Commands(self.entries)
            self.commands = lazy

    def format_options(self, ctx: Any, formatter: Any) -> None:
        """Write the commands of each group, then the options."""
        groups: dict[str, list[tuple[str, str]]] = {}
        for name, entry in self.entries.items():
            groups.setdefault(entry.group, []).append((name, entry.summary))
        _write_groups(formatter, groups)
        _Help.format_options(self, ctx, formatter)
        if not self.entries:
            self.format_commands(ctx, formatter)


def command_group(summary: str) -> typer.Typer:
    """Return a group for commands of its own; without a command it shows its help."""
    group = typer.Typer(
        cls=GroupedCommands, help=summary, add_completion=False, rich_markup_mode=None
    )

    @group.callback(invoke_without_command=True)
    def show_help(context: typer.Context) -> None:
        if context.invoked_subcommand is None:
            typer.echo(context.get_help())

    return group


def _write_groups(formatter: Any, groups: Mapping[str, Iterable[tuple[str, str]]]) -> None:
    """Write rows under headings, with one width of the first column for all."""
    rows = [row for group in groups.values() for row in group]
    width = max((len(name) for name, _ in rows if len(name) <= MAX_NAME), default=0)
    formatter.write("\n" * bool(rows))
    for heading, group in groups.items():
        formatter.write(f"{_heading(heading)}:\n")
        with formatter.indentation():
            formatter.write_dl([(name.ljust(width), text) for name, text in group], MAX_NAME)


MAX_NAME = 30
"""Longest name of an option, with its value, that has its text on the same line."""


def _heading(text: str) -> str:
    return typer.style(text, bold=True) if sys.stdout.isatty() else text


def _default(param: Any) -> str:
    default = param.default
    shown = param.show_default and default not in (None, "", ()) and default is not False
    return f"  [default: {default}]" if shown and not param.required else ""


def _paragraphs(docstring: str) -> str:
    """Return a docstring of which each paragraph is one line: terminals break them themselves."""
    return "\n\n".join(" ".join(each.split()) for each in inspect.cleandoc(docstring).split("\n\n"))
