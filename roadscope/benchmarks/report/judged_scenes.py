"""Detections and tracks of an episode with what was right and wrong in each frame."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from roadscope.benchmarks.eligibility import Eligibility
from roadscope.benchmarks.metrics.detection import GATE_M
from roadscope.benchmarks.metrics.matching import Pairing, match
from roadscope.benchmarks.metrics.tracking.clear import switched
from roadscope.benchmarks.metrics.tracking.matching import match_tracks
from roadscope.benchmarks.metrics.tracking.scores import (
    counted_rows,
    counted_sequence,
    matched_rows,
)
from roadscope.benchmarks.records import EpisodeDetections, EpisodeTracks
from roadscope.benchmarks.report.replay_records import FrameBoxes, boxes_of
from roadscope.core import Tracks, Truth

SWITCHES, MISSES, ALARMS = "identity switches", "misses", "false alarms"
MARGIN_M = 10.0
"""How far objects and lanes are shown beyond the range in which objects are eligible."""


@dataclass(frozen=True, slots=True)
class JudgedScene:
    """An episode with what was right and wrong in each frame.

    objects, answers: true boxes, and those of the entry, with their states.
    switches: by frame, texts about switches of identities.
    reach_m: how far from the ego boxes are shown.
    """

    truths: Sequence[Truth]
    objects: Sequence[FrameBoxes]
    answers: Sequence[FrameBoxes]
    switches: Mapping[int, Sequence[str]]
    reach_m: float

    def wrong(self, kind: str) -> list[np.ndarray]:
        """Return for each frame (N,) bool: which boxes are wrong, answers for false alarms.

        For switches and misses these are objects.
        """
        boxes = self.answers if kind == ALARMS else self.objects
        letter = {SWITCHES: "s", MISSES: "x", ALARMS: "f"}[kind]
        return [frame.states == letter for frame in boxes]

    def counts(self, kind: str) -> np.ndarray:
        """Return (T,) how often something went wrong in each frame."""
        return np.array([int(rows.sum()) for rows in self.wrong(kind)])

    def hits(self) -> np.ndarray:
        """Return (T,) how many objects were matched in each frame."""
        return np.array([int(np.isin(frame.states, ("m", "s")).sum()) for frame in self.objects])


def judged_scene(
    answers: EpisodeTracks | EpisodeDetections, inputs: EpisodeDetections, rule: Eligibility
) -> JudgedScene:
    """Match answers with the objects of each frame. inputs: with the truth of the frames."""
    truths = inputs.truths
    objects = [boxes_of(truth, truth.ids) for truth in truths]
    switches: Mapping[int, Sequence[str]] = {}
    if isinstance(answers, EpisodeTracks):
        pairings = rule.pairings(answers.tracks, truths, inputs.parked)
        boxes = [boxes_of(tracks, tracks.ids) for tracks in answers.tracks]
        switches = _judge_tracks(answers.tracks, truths, pairings, objects, boxes)
    else:
        pairings = rule.pairings(answers.detections, truths, inputs.parked)
        boxes = [boxes_of(each, np.full(len(each), -1)) for each in answers.detections]
        _judge_detections(pairings, objects, boxes)
    return JudgedScene(truths, objects, boxes, switches, rule.range_m[1] + MARGIN_M)


def _judge_detections(
    pairings: Sequence[Pairing], objects: Sequence[FrameBoxes], boxes: Sequence[FrameBoxes]
) -> None:
    """Write the states of the objects and of the detected boxes of each frame."""
    for true, detected, pairing in zip(objects, boxes, pairings, strict=True):
        matching = match(pairing, GATE_M)
        true.states[matching.misses] = "x"
        detected.states[matching.false_alarms] = "f"
        true.states[matching.truth] = "m"
        detected.states[matching.detected] = "m"


def _judge_tracks(
    tracks: Sequence[Tracks],
    truths: Sequence[Truth],
    pairings: Sequence[Pairing],
    objects: Sequence[FrameBoxes],
    boxes: Sequence[FrameBoxes],
) -> dict[int, list[str]]:
    """Write the states of the objects and tracks of each frame; return the texts of switches."""
    counted = counted_rows(pairings)
    sequence = counted_sequence(tracks, truths, pairings, counted)
    matched = match_tracks(sequence)
    pairs = matched_rows(sequence, matched, counted)
    is_switch = switched(matched.objects, matched.tracks)
    switches: dict[int, list[str]] = {}
    last_tracks: dict[int, int] = {}
    for k, frame in enumerate(matched.frames.tolist()):
        number = int(sequence.truth_ids[matched.truth_rows[k]])
        track = int(sequence.track_ids[matched.track_rows[k]])
        if is_switch[k]:
            text = f"object {number} goes from track {last_tracks[number]} to track {track}"
            switches.setdefault(frame, []).append(text)
        last_tracks[number] = track
    ends = np.searchsorted(matched.frames, np.arange(len(truths) + 1))
    for t, (frame_counted, pair) in enumerate(zip(counted, pairs, strict=True)):
        objects[t].states[frame_counted.objects] = "x"
        boxes[t].states[frame_counted.tracks] = "f"
        letters = np.where(is_switch[ends[t] : ends[t + 1]], "s", "m")
        objects[t].states[pair.objects] = letters
        boxes[t].states[pair.tracks] = letters
    return switches
