"""`roadscope train`."""

from __future__ import annotations

from pathlib import Path

from roadscope.commands import completion, options
from roadscope.commands.help import GroupedCommand, command_group
from roadscope.commands.options import option, workers
from roadscope.commands.terminal import headline, progress_bars, say, show

train = command_group(
    "Train the camera detector on simulated pictures, or a driver in simulated traffic."
)


@train.command("camera", cls=GroupedCommand)
def camera(
    recipe: str = option(
        "NAME", "full (half an hour on two cores), small or trial", default="full"
    ),
    seed: int = option("N", "Seed of all random draws", min=0, default=0),
    jobs: int = options.JOBS,
    work: Path | None = option("DIR", "For pictures (up to 5 GB) and checkpoints; else the cache"),
    out: Path = option(
        "FILE", "The weights; a .toml comes beside it", default=Path("network.safetensors")
    ),
    quiet: bool = options.QUIET,
) -> None:
    """Train the camera detector on simulated pictures.

    Pictures and checkpoints of an earlier run are used: a stopped run continues.
    """
    from roadscope.benchmarks.train.camera import train_camera

    with progress_bars(quiet=quiet) as progress:
        result = train_camera(
            out, recipe=recipe, seed=seed, work=work, jobs=workers(jobs), progress=progress
        )
    if quiet:
        return
    from roadscope.benchmarks.tables import score_table

    for name, scores in {"validation seeds": result.scores, **result.held_out}.items():
        headline(f"{name.replace('_', ' ')}: {scores.ap50.n} road users")
        show(score_table(scores.named()))
    say(f"written: {result.weights}, {result.record}")


@train.command(
    "driver",
    cls=GroupedCommand,
    short_help="Train a driver by imitation and by reinforcement learning.",
)
def driver(
    perception: list[str] | None = option(
        "STACK",
        "What it drives on: DETECTOR + TRACKER [+ N ms], truth (default) or blind; if repeated, "
        "each drive draws one",
    ),
    scenario: list[str] | None = option(
        "NAME",
        "Default: all of the suite driving; if repeated, each drive draws one",
        names=completion.scenarios,
    ),
    start: str = option(
        "AGENT",
        "Train this agent further: a file, or a shipped one, truth or perceived",
        default="",
    ),
    teacher: str = option(
        "DRIVER",
        "Driver that a new agent imitates; it gets the truth; '': none",
        default="idm-mobil",
    ),
    steps: int = option(
        "N", "Decisions (0.2 s each) to learn from by PPO; needs the extra rl", min=0, default=0
    ),
    seconds: float = option("S", "Longest time of a drive", min=1.0, max=600.0, default=30.0),
    rig: str = option("NAME", "Sensors of the stack", names=completion.rigs, default="vlp16"),
    seed: int = option("N", "Seed of all random draws", min=0, default=0),
    out: Path = option(
        "FILE", "The weights; a .toml comes beside it", default=Path("driver.safetensors")
    ),
    quiet: bool = options.QUIET,
) -> None:
    """Train a driver: by imitation of another one, then by reinforcement learning (PPO)."""
    from roadscope.benchmarks.train.driver import DriverRecipe, train_driver

    recipe = DriverRecipe(
        perceptions=tuple(perception or ("truth",)),
        scenarios=tuple(scenario or ()),
        start=start,
        teacher=teacher,
        steps=steps,
        duration_s=seconds,
        rig=rig,
        seed=seed,
    )
    with progress_bars(quiet=quiet) as progress:
        result = train_driver(out, recipe, progress=progress)
    if quiet:
        return
    for name, scores in result.scores.items():
        reward, collided = scores.mean(axis=0)
        say(
            f"on {name}: reward {reward:.2f}, collisions in {collided:.0%} of {len(scores)} drives "
            "(validation seeds)"
        )
    say(f"written: {result.weights}, {result.record}")
    say(f"next: roadscope leaderboard driving --entry 'learned?weights={result.weights}'")
