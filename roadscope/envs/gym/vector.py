"""Several environments as one, stepped by a few processes."""

from __future__ import annotations

import multiprocessing
import os
import pickle
import signal
import traceback
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from copy import deepcopy
from functools import partial
from multiprocessing.connection import Connection, wait
from multiprocessing.reduction import ForkingPickler
from typing import Any, NamedTuple

import gymnasium as gym
import numpy as np
from gymnasium.vector import AutoresetMode
from gymnasium.vector.utils import (
    batch_space,
    create_shared_memory,
    iterate,
    read_from_shared_memory,
    write_to_shared_memory,
)

from roadscope.envs.gym.observer import checked_seed

ENDING_S = 5.0
"""A process that does not end within this time after it was asked to is killed. Chosen by hand."""
LARGE_BYTES = 65_536
"""Arrays of this size or more are sent by themselves, as they lie. Chosen by hand."""

Ended = tuple[float, bool, bool]
"""Reward, terminated and truncated of a step."""


class _Share(NamedTuple):
    """What a worker process needs: how to make an environment, and the rows of its own."""

    make_env: Callable[[], gym.Env[Any, Any]]
    rows: Sequence[int]
    space: gym.Space[Any]
    observations: Any


class PooledVectorEnv(gym.vector.VectorEnv[Any, Any, Any]):
    """Several environments of one kind, shared among one process for each core.

    make_env: makes one environment; it must be possible to pickle it where processes are not
        forked.
    num_envs: number of environments.
    workers: number of processes; None: one for each core, and not more than environments.
    copy: whether each batch of observations is an array of its own; otherwise the next step writes
        over it.

    Environments write their observations into one array that all processes share, so observations
    are not sent. Observations, rewards, ends of episodes and infos equal those of
    `gymnasium.vector.SyncVectorEnv` with the same seeds: a new episode begins with the step after
    the last one of an episode (`AutoresetMode.NEXT_STEP`). `call`, `get_attr` and `set_attr` do not
    exist here. Processes start by the method of `multiprocessing.set_start_method`.

    An error of an environment is raised when the others have taken their step. If a process dies,
    `RuntimeError` is raised, and all are closed.

    Threads gained little with a LiDAR alone: most of such a step is Python, which holds the
    interpreter's lock. With `records=True` frames are sent too, which takes much of the gain.
    """

    metadata = {"autoreset_mode": AutoresetMode.NEXT_STEP}  # noqa: RUF012

    def __init__(
        self,
        make_env: Callable[[], gym.Env[Any, Any]],
        num_envs: int = 1,
        *,
        workers: int | None = None,
        copy: bool = True,
    ) -> None:
        from joblib import cpu_count

        for name, number in (("num_envs", num_envs), ("workers", workers)):
            if number is not None and number < 1:
                raise ValueError(f"{name}: expected a whole number from 1 up, got {number!r}")
        one = make_env()
        self.single_observation_space, self.single_action_space = (
            one.observation_space,
            one.action_space,
        )
        self.metadata = {**one.metadata, **type(self).metadata}
        self.render_mode = one.render_mode
        one.close()
        self.num_envs, self._copy = num_envs, copy
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)
        context = multiprocessing.get_context()
        # Kept: without it the locks would be gone before a process that is not forked takes them.
        self._shared = shared = create_shared_memory(
            self.single_observation_space,
            num_envs,
            context,  # type: ignore[arg-type]
        )
        self._observations = read_from_shared_memory(
            self.single_observation_space, shared, num_envs
        )
        count = min(num_envs, int(cpu_count()) if workers is None else workers)
        self._workers: list[_Worker] = []
        self._pid = os.getpid()
        for number in range(count):
            share = _Share(
                make_env, range(number, num_envs, count), self.single_observation_space, shared
            )
            self._workers.append(_Worker(context, share))

    def reset(
        self,
        *,
        seed: int | Sequence[int | None] | None = None,
        options: dict[str, Any] | None = None,
    ) -> tuple[Any, dict[str, Any]]:
        """Begin an episode in each environment.

        seed: one for each environment; of a single number the i-th gets seed + i.
        options: for every environment, but `reset_mask`, (num_envs,) bool: where it is False an
            episode goes on.
        """
        options = dict(options or {})
        chosen = np.asarray(options.pop("reset_mask", np.ones(self.num_envs, bool)))
        if chosen.shape != (self.num_envs,) or chosen.dtype != bool or not chosen.any():
            raise ValueError(f"reset_mask: expected {self.num_envs} bool, one of them True")
        if isinstance(seed, Sequence | np.ndarray):
            seeds = [checked_seed(each) for each in seed]
            if len(seeds) != self.num_envs:
                raise ValueError(f"seed: expected {self.num_envs} seeds, got {len(seeds)}")
        else:
            first = checked_seed(seed)
            seeds = [None if first is None else first + row for row in range(self.num_envs)]
        infos = self._ask(
            "reset", {row: (seeds[row], options or None) for row in np.flatnonzero(chosen).tolist()}
        )
        return self._batch(), self._joined(infos)

    def step(self, actions: Any) -> tuple[Any, np.ndarray, np.ndarray, np.ndarray, dict[str, Any]]:
        """Take one step in each environment."""
        each = list(iterate(self.action_space, actions))
        if len(each) != self.num_envs:
            raise ValueError(f"actions: expected {self.num_envs}, got {len(each)}")
        answers = self._ask("step", dict(enumerate(each)))
        rewards, terminated, truncated = zip(*(ended for ended, _ in answers.values()), strict=True)
        return (
            self._batch(),
            np.array(rewards, np.float64),
            np.array(terminated, bool),
            np.array(truncated, bool),
            self._joined({row: info for row, (_, info) in answers.items()}),
        )

    def render(self) -> tuple[Any, ...] | None:
        """Return one picture of each environment."""
        return tuple(self._ask("render", dict.fromkeys(range(self.num_envs))).values())

    def close_extras(self, **_: Any) -> None:
        """End the processes."""
        if os.getpid() != self._pid:
            return  # A fork of this process has the object, but not the processes.
        for worker in self._workers:
            worker.dismiss()
        for worker in self._workers:
            worker.end()

    def __del__(self) -> None:
        """End the processes of an environment that was not closed."""
        if hasattr(self, "_workers"):
            self.close()

    def _ask(self, call: str, arguments: Mapping[int, Any]) -> dict[int, Any]:
        """Let environments do something at the same time; return their answers, by row."""
        if self.closed:
            raise gym.error.ClosedEnvironmentError(f"{call}() after close()")
        answers: dict[int, Any] = {}
        errors: list[Exception] = []
        shares = [{r: arguments[r] for r in w.rows if r in arguments} for w in self._workers]
        messages = [ForkingPickler.dumps((call, share)) for share in shares]
        try:
            for worker, message in zip(self._workers, messages, strict=True):
                worker.send(message)
            for worker in self._workers:
                answer = worker.receive()
                if isinstance(answer, Exception):
                    errors.append(answer)
                else:
                    answers.update(answer)
        except BaseException:
            # A process died, or Ctrl-C: the next call would take answers that are still to come.
            self.close()
            raise
        if errors:
            raise errors[0]
        return {row: answers[row] for row in arguments}

    def _batch(self) -> Any:
        return deepcopy(self._observations) if self._copy else self._observations

    def _joined(self, infos: Mapping[int, Mapping[str, Any]]) -> dict[str, Any]:
        joined: dict[str, Any] = {}
        for row, info in infos.items():
            joined = self._add_info(joined, dict(info), row)
        return joined


class _Worker:
    """A process with its share of the environments."""

    def __init__(self, context: Any, share: _Share) -> None:
        self.rows = share.rows
        self.connection, other = context.Pipe()
        self._process = context.Process(target=_work, args=(other, share), daemon=True)
        self._process.start()
        other.close()

    def send(self, message: memoryview) -> None:
        """Ask the environments to do something; `receive` has their answers."""
        try:
            self.connection.send_bytes(message)
        except OSError as error:
            raise self._lost() from error

    def receive(self) -> Any:
        """Return the answers by row, or the exception that one of the environments raised."""
        try:
            return _received(self.connection)
        except (EOFError, OSError) as error:
            raise self._lost() from error

    def dismiss(self) -> None:
        """Ask the process to end."""
        with suppress(OSError):
            self.connection.send(None)
        self.connection.close()

    def end(self) -> None:
        """Wait until the process has ended, and kill it if that takes long."""
        self._process.join(ENDING_S)
        if self._process.is_alive():
            self._process.kill()
            self._process.join()

    def _lost(self) -> RuntimeError:
        self._process.join(ENDING_S)
        rows = ", ".join(map(str, self.rows))
        return RuntimeError(
            f"the process of the environments {rows} ended with status {self._process.exitcode}; "
            "all environments are closed"
        )


def _work(connection: Connection, share: _Share) -> None:
    """Run a share of the environments until the parent says so, or is gone."""
    # Ctrl-C reaches all processes of a terminal. What follows is the parent's decision.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    parent = multiprocessing.parent_process()
    assert parent is not None
    envs: dict[int, gym.Env[Any, Any]] = {}
    needs_reset = dict.fromkeys(share.rows, False)

    def reset(row: int, seed: int | None, options: Any) -> Any:
        observation, info = envs[row].reset(seed=seed, options=options)
        write_to_shared_memory(share.space, row, observation, share.observations)
        needs_reset[row] = False
        return info

    def step(row: int, action: Any) -> tuple[Ended, Any]:
        if needs_reset[row]:
            return (0.0, False, False), reset(row, None, None)
        observation, reward, terminated, truncated, info = envs[row].step(action)
        write_to_shared_memory(share.space, row, observation, share.observations)
        needs_reset[row] = bool(terminated or truncated)
        return (float(reward), bool(terminated), bool(truncated)), info

    def answer(call: str, row: int, argument: Any) -> Any:
        if row not in envs:
            envs[row] = share.make_env()
        if call == "step":
            return step(row, argument)
        return reset(row, *argument) if call == "reset" else envs[row].render()

    while connection in wait([connection, parent.sentinel]):
        try:
            request = connection.recv()
        except (EOFError, OSError):
            break
        if request is None:
            break
        call, arguments = request
        answers, failed = {}, None
        for row, argument in arguments.items():
            try:
                answers[row] = answer(call, row, argument)
            except Exception as error:
                failed = failed or _sent(error)
        try:
            _send(connection, failed or answers)
        except OSError:
            break
        except Exception as error:
            _send(connection, RuntimeError(f"what {call}() returned cannot be sent: {error}"))
    for env in envs.values():
        env.close()


def _send(connection: Connection, answer: Any) -> None:
    """Send an answer and, after it, the contents of its large arrays, which are not pickled."""
    contents: list[memoryview] = []

    def is_small(buffer: pickle.PickleBuffer) -> bool:
        content = buffer.raw()
        if content.nbytes < LARGE_BYTES:
            return True
        contents.append(content)
        return False

    pickled = pickle.dumps(answer, 5, buffer_callback=is_small)
    connection.send((pickled, [each.nbytes for each in contents]))
    for each in contents:
        connection.send_bytes(each)


def _received(connection: Connection) -> Any:
    """Return what `_send` sent."""
    pickled, sizes = connection.recv()
    contents = [np.empty(size, np.uint8) for size in sizes]
    for each in contents:
        connection.recv_bytes_into(each)
    return pickle.loads(pickled, buffers=contents)


def _sent(error: Exception) -> Exception:
    """Return an error with the worker's traceback, or one with its text if it cannot be sent."""
    text = "".join(traceback.format_exception(error))
    error.add_note(text)
    try:
        pickle.loads(pickle.dumps(error))
    except Exception:
        return RuntimeError(text)
    return error


def pooled(
    kind: Callable[..., gym.Env[Any, Any]],
    num_envs: int,
    *,
    workers: int | None = None,
    copy: bool = True,
    max_episode_steps: int | None = None,
    **settings: Any,
) -> PooledVectorEnv:
    """Return several environments of a class as one, for `gymnasium.make_vec`.

    max_episode_steps: as in `gymnasium.make`. settings: of the class. Others: of `PooledVectorEnv`.
    """
    make_env = partial(_made, kind, max_episode_steps, settings)
    return PooledVectorEnv(make_env, num_envs, workers=workers, copy=copy)


def _made(
    kind: Callable[..., gym.Env[Any, Any]], steps: int | None, settings: Mapping[str, Any]
) -> gym.Env[Any, Any]:
    env = kind(**settings)
    return env if steps in (None, -1) else gym.wrappers.TimeLimit(env, steps)
