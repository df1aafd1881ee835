"""Which field of a scan's points is what: decided by what is in it, for all scans of a folder."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from roadscope.benchmarks.formats.bags import Source
from roadscope.benchmarks.formats.beams import (
    MAX_BEAM_HEIGHT_RAD,
    azimuth_steps,
    azimuths_of,
    ranked_rings,
    rings_of,
    shows_beams,
    why_no_beams,
)
from roadscope.benchmarks.formats.point_fields import (
    FEWEST_COLUMNS,
    IGNORED,
    PLACE,
    POINT_TIMES_FOLDER,
    TIME,
    PointFields,
    column_name,
    is_raw,
    read_fields,
    readable,
    unnamed,
)
from roadscope.benchmarks.formats.raw_width import width_of
from roadscope.benchmarks.formats.scan_stamps import (
    TIME_UNITS,
    TIME_UNITS_S,
    UNIT_NAMES,
    time_unit_s,
)
from roadscope.benchmarks.formats.table import FormatError
from roadscope.core import LidarScan, RecordError
from roadscope.core.names import unknown
from roadscope.core.scan import FARTHEST_M

MIN_SWEEP_S = 0.005
MAX_SWEEP_S = 1.0
"""The time between the first and the last point of a scan, by which the unit of their times is
known. Chosen by hand."""
TIME_FIELDS = (TIME, "t", "timestamp", "offset_time", "time_offset_s", "gps_time")
INTENSITY_FIELDS = ("intensity", "i", "reflectivity")
RING_FIELDS = ("ring", "channel", "line", "laser_number")
"""Names of a point's time, intensity and beam where fields have names; drivers differ."""
COLUMN_NAMES = (*PLACE, "intensity", "ring", TIME, IGNORED)
"""Names of columns in a layout that a user gives."""
MOST_STRAY = 0.05
"""With a larger share of times outside of the sweep, the times of a scan are not used."""
STRAY_SPANS = 0.5
"""A time is outside of the sweep if it lies farther from the middle 98 % than this share of their
length. Chosen by hand."""
MOST_FAR = 0.5
"""A scan with a larger share of points beyond `FARTHEST_M` is in another unit or frame."""
MEDIAN_RANGE_M = (0.2, 300.0)
"""Limits of the median distance of points from the sensor. Chosen by hand: it is 5 to 30 m on
roads; in millimetres it would be a thousand times as far."""
MOST_FALLING = 0.05
"""Times of a sweep fall from one point to the next at a smaller share of the points, if they are in
the order of the file. Chosen by hand: as numbers without an order they fall at half of them."""
SECTORS = 20
"""Parts of a sweep whose azimuths are compared with those of the whole sweep."""
NARROW = 0.25
"""The azimuths of a part of a sweep spread by less than this share of the whole's. Chosen by hand:
it is below 0.02 for a scanner that turns."""

NO_RETURN = "without a return (0 0 0 or not a number)"
FAR = f"farther than {FARTHEST_M:g} m"
STRAY = "with a time outside of the sweep"
WITHOUT_BEAM = "without a number of their beam"


class ReadScan(NamedTuple):
    """A scan, and how many points of its file are left out, by reason.

    lacks: which fields that other scans have are not used of it, and why.
    """

    scan: LidarScan
    left_out: Counter[str]
    lacks: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class PointLayout:
    """The names of the fields that are used, by what they are; None for what is not known.

    columns: names of the columns of `.bin` and `.npy` files; empty where the file has names.
    time_unit_s: seconds in one unit of the field of times.
    notes: what was assumed, and which fields are not used and why.
    """

    columns: tuple[str, ...] = ()
    intensity: str | None = None
    ring: str | None = None
    time: str | None = None
    time_unit_s: float = 1.0
    notes: tuple[str, ...] = ()

    def read(self, path: Source, stamp_s: float) -> ReadScan:
        """Read a scan, without points that are of no use.

        stamp_s: the middle of the sweep. The times of points count from there; without times, all
        points count as measured at once, as in a scan that was deskewed.
        """
        return self.scan_of(read_fields(path, self.columns), stamp_s, str(path))

    def middle_s(self, path: Source) -> float:
        """Return the middle of the times of a scan's points in seconds; nan without times."""
        times = read_fields(path, self.columns).others.get(self.time or "")
        inside = np.zeros(0) if times is None else times[~_outside_of_sweep(times)]
        return float(inside.min() + inside.max()) / 2 * self.time_unit_s if len(inside) else np.nan

    def scan_of(self, fields: PointFields, stamp_s: float, source: str) -> ReadScan:
        """Return a scan of fields; source: for error messages, where they are from."""
        times = None if self.time is None else fields.others.get(self.time)
        rings = None if self.ring is None else fields.others.get(self.ring)
        reasons = _reasons_against(fields.points, source)
        wanted = [name for name in (self.intensity, self.ring, self.time) if name]
        lacks = [f"no field '{name}'" for name in wanted if name not in fields.others]
        lacks += [fields.problem] if fields.problem else []
        if times is not None:
            stray, usable = _outside_of_sweep(times), ~np.any([*reasons.values()], axis=0)
            share = (stray & usable).sum() / max(int(usable.sum()), 1)
            if share > MOST_STRAY:
                lacks.append(f"{100 * share:.0f} % of its times are outside of the sweep")
                times = None
            elif (span_s := _span(times) * self.time_unit_s) > MAX_SWEEP_S:
                lacks.append(f"its times of points are over {span_s:.3g} s, which no sweep takes")
                times = None
            else:
                reasons[STRAY] = stray
        if rings is not None:
            reasons[WITHOUT_BEAM] = ~np.isfinite(rings)
        usable, left_out = np.ones(len(fields), bool), Counter[str]()
        for reason, wrong in reasons.items():
            left_out[reason] = int((wrong & usable).sum())
            usable &= ~wrong
        points = fields.points[usable].astype(np.float32)
        ranked = None if rings is None else ranked_rings(points, rings[usable])
        scan = LidarScan(
            points=points,
            intensity=self._intensities(fields, usable),
            ring=rings_of(points) if ranked is None else ranked,
            column=azimuth_steps(points),
            time_offset_s=np.zeros(len(points)) if times is None else self._offsets(times[usable]),
            stamp_s=stamp_s,
            sensor="lidar",
        )
        if ranked is None and rings is not None and len(points):
            lacks.append(f"the numbers of '{self.ring}' are not those of beams")
        return ReadScan(scan, +left_out, tuple(lacks))

    def _intensities(self, fields: PointFields, is_usable: np.ndarray) -> np.ndarray:
        """Return intensities of usable points from 0 to 1; the largest becomes 1 if it is above 1.

        An unknown one is 0.
        """
        values = None if self.intensity is None else fields.others.get(self.intensity)
        if values is None:
            return np.zeros(int(is_usable.sum()))
        values = np.where(np.isfinite(values[is_usable]), values[is_usable], 0.0)
        return np.clip(values / max(1.0, float(values.max(initial=0))), 0, 1)

    def _offsets(self, times: np.ndarray) -> np.ndarray:
        """Return (N,) seconds from the middle of the sweep; 0 where it has no length."""
        if not len(times):
            return np.zeros(0)
        span_s = float(times.max() - times.min()) * self.time_unit_s
        if not 0 < span_s <= MAX_SWEEP_S:
            return np.zeros(len(times))
        offsets: np.ndarray = (times - (times.max() + times.min()) / 2) * self.time_unit_s
        return offsets


def _reasons_against(points: np.ndarray, source: str) -> dict[str, np.ndarray]:
    """Return for each reason which of (N, 3) points cannot be used for it, (N,) bool.

    A scan most of whose points are too far is refused.
    """
    none = ~np.isfinite(points).all(axis=1) | ~points.any(axis=1)
    with np.errstate(invalid="ignore"):
        far = ~none & (np.abs(points) > FARTHEST_M).any(axis=1)
    share = far.sum() / max(int((~none).sum()), 1)
    if share > MOST_FAR:
        raise FormatError(
            f"{source}: {100 * share:.0f} % of the points are {FAR}: are they in coordinates of a "
            "map, or in millimetres?"
        )
    near = ~none & ~far
    if near.any():
        middle = float(np.median(np.linalg.norm(points[near], axis=1)))
        if not MEDIAN_RANGE_M[0] <= middle <= MEDIAN_RANGE_M[1]:
            raise FormatError(
                f"{source}: half of the points are farther than {middle:.3g} m and half are "
                "nearer: are they in metres from the sensor?"
            )
    return {NO_RETURN: none, FAR: far}


def scan_of_points(
    points: np.ndarray,
    stamp_s: float,
    *,
    intensities: np.ndarray | None = None,
    rings: np.ndarray | None = None,
    times_s: np.ndarray | None = None,
) -> LidarScan:
    """Return a scan of arrays, without the points of rays that had no return.

    points: (N, 3) x y z, metres, x ahead, y left, z up. stamp_s: the middle of the sweep.
    intensities: (N,) of any range. rings: (N,) numbers of the beams in any order. times_s: (N,)
    seconds from any origin. What is not known is left out, see `read_scan`. Arrays of other
    shapes, and times longer than a sweep, raise `RecordError`.
    """
    optional = {"intensity": intensities, "ring": rings, TIME: times_s}
    known = {name: np.asarray(v, np.float64) for name, v in optional.items() if v is not None}
    places = np.asarray(points, np.float64)
    if places.ndim != 2 or places.shape[1] != len(PLACE):
        raise RecordError(f"scan_of_points.points: expected shape (N, 3), got {places.shape}")
    for name, values in known.items():
        if values.shape != (len(places),):
            raise RecordError(
                f"scan_of_points, {name}: expected shape ({len(places)},), got {values.shape}"
            )
    span_s = _span(known.get(TIME, np.zeros(0)))
    if span_s > MAX_SWEEP_S:
        raise RecordError(
            f"scan_of_points, {TIME}: expected seconds, over up to {MAX_SWEEP_S:g} s, got "
            f"{span_s:.3g} from first to last"
        )
    layout = PointLayout(intensity="intensity", ring="ring", time=TIME)
    return layout.scan_of(PointFields(places, known), stamp_s, "scan_of_points").scan


# --------------------------------------------------------------------------------------------------
# Which field is what.


class FieldCandidate(NamedTuple):
    """A field that may be what is looked for.

    why_not: returns why the field of a file cannot be it; empty if it can.
    """

    name: str
    why_not: Callable[[PointFields], str]


class Choice(NamedTuple):
    """The first candidate that fits most files, None if none does, and why others do not."""

    name: str | None
    reasons: Mapping[str, str]


def parse_columns(text: str) -> tuple[str, ...]:
    """Return the names of columns of a layout, such as `x,y,z,intensity,ring,_`."""
    names = tuple(text.replace(",", " ").split())
    for name in names:
        if name not in COLUMN_NAMES:
            raise FormatError(f"layout '{text}': {unknown('column', name, COLUMN_NAMES)}")
    once = [name for name in names if name != IGNORED]
    if len(once) != len(set(once)) or not set(PLACE) <= set(names):
        raise FormatError(f"layout '{text}': expected x, y and z, and each name once")
    return names


def layout_of(samples: Sequence[Source], columns: Sequence[str] = ()) -> PointLayout:
    """Return which fields the points of some files have, which stand for all of a folder.

    columns: the names of columns if the user knows them; what is in them is then not doubted,
        but for times that no sweep has.
    A file that cannot be read does not count, unless none can.
    """
    chosen, notes = tuple(columns), []
    raw = [path for path in samples if is_raw(path)]
    if not chosen and raw:
        width = width_of(raw)
        chosen = unnamed(width)
        notes.append(f"points of {width} floats are read: {' '.join(chosen)}")
    files = [
        each for each in readable(lambda file: read_fields(file, chosen), samples) if len(each)
    ]
    if not files:
        return PointLayout(chosen, notes=("the scans looked at have no points",))
    layout = _named_layout(files, trusted=bool(columns))
    if column_name(FEWEST_COLUMNS + 1) in files[0].others:
        layout = _with_unnamed(layout, files)
    notes += [*layout.notes, *_uses(layout, files[0])]
    if layout.time is None:
        notes.append(
            "points without times: each scan is taken to be seen at once, or to be deskewed already"
        )
    if layout.ring is None and not any(shows_beams(_sound_points(each)) for each in files):
        notes.append(
            "nothing shows which beam a point is of: bands of elevation stand for beams, of "
            f"{np.rad2deg(MAX_BEAM_HEIGHT_RAD):g} degrees each"
        )
    layout = replace(layout, columns=chosen, notes=tuple(notes))
    next(readable(lambda file: layout.read(file, 0.0), samples), None)
    return layout


def _uses(layout: PointLayout, file: PointFields) -> list[str]:
    """Return a note on which fields are used as what."""
    time = POINT_TIMES_FOLDER if file.times_beside else layout.time
    named = {
        "intensity": layout.intensity,
        "number of the beam": layout.ring,
        f"time of points in {UNIT_NAMES[layout.time_unit_s]}": layout.time and time,
    }
    uses = [f"{name} as {what}" for what, name in named.items() if name]
    return [f"used of the points besides x y z: {', '.join(uses)}"] if uses else []


def _chosen(candidates: Sequence[FieldCandidate], files: Sequence[PointFields]) -> Choice:
    reasons: dict[str, str] = {}
    for name, why_not in candidates:
        doubts = [why_not(each) for each in files if name in each.others]
        against = [doubt for doubt in doubts if doubt]
        if doubts and 2 * len(against) <= len(doubts):
            return Choice(name, reasons)
        if against:
            reasons[name] = against[0]
    return Choice(None, reasons)


def _named_layout(files: Sequence[PointFields], *, trusted: bool) -> PointLayout:
    """Return the layout by the names of fields; what is in a field decides if it is used."""
    intensities = [FieldCandidate(name, lambda _: "") for name in INTENSITY_FIELDS]
    rings = [FieldCandidate(name, _why_not_ring(name)) for name in RING_FIELDS]
    why_not = _why_not_time if trusted else _why_not_sweep
    times = [FieldCandidate(name, why_not(name, TIME_UNITS_S)) for name in TIME_FIELDS]
    ring = Choice("ring", {}) if trusted and "ring" in files[0].others else _chosen(rings, files)
    time = _chosen(times, files)
    if trusted and TIME in time.reasons:
        raise FormatError(f"layout: '{TIME}': {time.reasons[TIME]}")
    notes = [
        f"field '{name}' is not used as {what}: {reason}"
        for what, choice in (("number of the beam", ring), ("time of points", time))
        for name, reason in choice.reasons.items()
    ]
    return PointLayout(
        intensity=_chosen(intensities, files).name,
        ring=ring.name,
        time=time.name,
        time_unit_s=1.0 if time.name is None else _unit_s(files, time.name),
        notes=tuple(notes),
    )


def _with_unnamed(layout: PointLayout, files: Sequence[PointFields]) -> PointLayout:
    """Return the layout with columns that have no names: the fourth is the intensity.

    Later ones are beams or times in seconds if they look like it.
    """
    notes: list[str] = list(layout.notes)
    names = [name for name in files[0].others if name != TIME]
    if names:
        layout = replace(layout, intensity=names[0])
    for name in names[1:]:
        ring = _chosen([FieldCandidate(name, _why_not_ring(name))], files)
        time = _chosen([FieldCandidate(name, _why_not_sweep(name, TIME_UNITS_S[:1]))], files)
        if ring.name and layout.ring is None:
            layout = replace(layout, ring=name)
        elif time.name and layout.time is None:
            layout = replace(layout, time=name)
        else:
            beam, sweep = ring.reasons.get(name, ""), time.reasons.get(name, "")
            why = f": no number of a beam ({beam}), no time in seconds ({sweep})" if beam else ""
            notes.append(f"{name} is not used{why}")
    return replace(layout, notes=tuple(notes))


def _sound(file: PointFields) -> np.ndarray:
    """Return (N,) bool, which points have finite coordinates that are not all 0."""
    sound: np.ndarray = np.isfinite(file.points).all(axis=1) & file.points.any(axis=1)
    return sound


def _sound_points(file: PointFields) -> np.ndarray:
    points: np.ndarray = file.points[_sound(file)]
    return points


def _why_not_ring(name: str) -> Callable[[PointFields], str]:
    def why_not(file: PointFields) -> str:
        sound = _sound(file)
        return why_no_beams(file.points[sound], file.others[name][sound]) if sound.any() else ""

    return why_not


def _why_not_time(name: str, units_s: Sequence[float]) -> Callable[[PointFields], str]:
    def why_not(file: PointFields) -> str:
        times = file.others[name]
        if not np.isfinite(times).any():
            return "no numbers"
        span = _span(times)
        if span == 0:
            return "the same for all points"
        unit_s = time_unit_s(span, shortest_s=MIN_SWEEP_S, longest_s=MAX_SWEEP_S)
        if unit_s not in units_s:
            units = TIME_UNITS if len(units_s) > 1 else f"in {UNIT_NAMES[units_s[0]]}"
            return (
                f"expected times of points over {MIN_SWEEP_S * 1000:g} ms to {MAX_SWEEP_S:g} s, "
                f"{units}, got {span:g} from first to last"
            )
        return "its numbers are those of beams" if not _why_not_ring(name)(file) else ""

    return why_not


def _why_not_sweep(name: str, units_s: Sequence[float]) -> Callable[[PointFields], str]:
    """Return `_why_not_time` that also refuses times that do not follow the points of a sweep."""
    by_span = _why_not_time(name, units_s)

    def why_not(file: PointFields) -> str:
        if reason := by_span(file):
            return reason
        return (
            "" if _follows_sweep(file.points, file.others[name]) else "it does not follow a sweep"
        )

    return why_not


def _follows_sweep(points: np.ndarray, times: np.ndarray) -> bool:
    """Return whether times rise along the file, or points of one part of them are in a sector.

    They fall where another beam, or another unit, begins.
    """
    sound = np.isfinite(points).all(axis=1) & np.isfinite(times)
    points, times = points[sound], times[sound]
    if (np.diff(times) < 0).sum() <= MOST_FALLING * len(times):
        return True
    if len(times) < SECTORS:
        return False
    directions = np.exp(1j * azimuths_of(points))
    parts = np.array_split(directions[np.argsort(times, kind="stable")], SECTORS)
    spread = 1 - np.mean([abs(part.mean()) for part in parts])
    return bool(spread < NARROW * (1 - abs(directions.mean())))


def _outside_of_sweep(times: np.ndarray) -> np.ndarray:
    """Return (N,) whether times are far from most others, or no numbers."""
    finite = np.isfinite(times)
    if not finite.any():
        return np.ones(len(times), bool)
    low, high = np.quantile(times[finite], [0.01, 0.99])
    margin = STRAY_SPANS * (high - low)
    outside: np.ndarray = ~(finite & (times >= low - margin) & (times <= high + margin))
    return outside


def _span(times: np.ndarray) -> float:
    """Return the time from the first to the last point, without times outside of the sweep."""
    inside = times[~_outside_of_sweep(times)]
    return float(inside.max() - inside.min()) if len(inside) else 0.0


def _unit_s(files: Sequence[PointFields], name: str) -> float:
    """Return the unit of a field of times, by its median span."""
    spans = [_span(each.others[name]) for each in files if name in each.others]
    span = float(np.median([span for span in spans if span > 0]))
    return time_unit_s(span, shortest_s=MIN_SWEEP_S, longest_s=MAX_SWEEP_S) or 1.0
