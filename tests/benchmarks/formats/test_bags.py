"""Scans, IMU samples and images in bags of ROS 2."""

import re
import sqlite3
from contextlib import closing

import numpy as np
import pytest
from toy_bags import START_NS, cloud, image, imu, write_bag
from toy_drive import driven

from roadscope.benchmarks.formats import ImageFolder, read_bag_imu
from roadscope.formats import FormatError, ScanFolder

SCANS = [scan for scan, _ in driven(4)[1]]
START_S = START_NS * 1e-9


def fields(scan, **others):
    places = dict(zip("xyz", scan.points.T, strict=True))
    return {**places, "intensity": scan.intensity, **others}


def clouds(topic="/points", late_s=0.02):
    """A cloud for each scan, stamped at the beginning of its sweep, with times of points."""
    messages = []
    for k, scan in enumerate(SCANS):
        times_s = scan.time_offset_s + np.float32(0.05)
        whole = fields(scan, ring=scan.ring.astype("u2"), t=times_s)
        messages.append((0.1 * k + late_s, topic, cloud(0.1 * k, whole)))
    return messages


@pytest.mark.parametrize("mcap", [False, True])
@pytest.mark.parametrize("inside", [False, True])
def test_scans_of_a_bag_are_those_that_were_written(tmp_path, mcap, inside):
    bag = write_bag(tmp_path / "bag", clouds(), mcap=mcap)
    path = next(bag.glob("*.mcap" if mcap else "*.db3")) if inside else bag
    read = ScanFolder.find(path)
    assert read.names == ["000000", "000001", "000002", "000003"]
    for one, two in zip(read, SCANS, strict=True):
        assert np.array_equal(one.points, two.points)
        assert np.array_equal(one.ring, two.ring)
        assert one.time_offset_s == pytest.approx(two.time_offset_s, abs=1e-3)
        # The stamp of a message is the beginning of its sweep, that of a scan its middle.
        assert one.stamp_s - START_S == pytest.approx(two.stamp_s, abs=1e-3)
    assert [len(scan) for scan in read.part(2, 3)] == [len(SCANS[2])]
    assert not read.losses.scans


def test_points_may_have_times_of_the_clock(tmp_path):
    messages = []
    for k, scan in enumerate(SCANS):
        times_s = START_S + 0.1 * k + 0.05 + scan.time_offset_s.astype("f8")
        messages.append((0.1 * k, "/points", cloud(0.1 * k, fields(scan, timestamp=times_s))))
    read = ScanFolder.find(write_bag(tmp_path / "bag", messages))
    assert np.array(read.stamps_s) - START_S == pytest.approx([s.stamp_s for s in SCANS], abs=1e-3)


def test_stamps_without_times_of_points_are_used_and_reported(tmp_path):
    messages = [(0.1 * k, "/p", cloud(0.1 * k, fields(s))) for k, s in enumerate(SCANS)]
    read = ScanFolder.find(write_bag(tmp_path / "bag", messages))
    assert np.array(read.stamps_s) - START_S == pytest.approx([0, 0.1, 0.2, 0.3], abs=1e-6)
    assert any("taken for the middle" in note for note in read.notes)


@pytest.mark.parametrize("options", [{"order": ">"}, {"rows": 2, "gap": 12}])
def test_other_orders_of_bytes_and_rows_with_gaps(tmp_path, options):
    even = [scan for scan in SCANS if len(scan) % options.get("rows", 1) == 0]
    messages = [(0.1 * k, "/p", cloud(0.1 * k, fields(s), **options)) for k, s in enumerate(even)]
    read = ScanFolder.find(write_bag(tmp_path / "bag", messages))
    assert even
    for one, two in zip(read, even, strict=True):
        assert np.array_equal(one.points, two.points)


def test_messages_come_in_the_order_of_their_stamps(tmp_path):
    messages = clouds()
    messages[1], messages[2] = (0.2, *messages[2][1:]), (0.2, *messages[1][1:])
    read = ScanFolder.find(write_bag(tmp_path / "bag", messages))
    assert [len(scan) for scan in read] == [len(scan) for scan in SCANS]
    for one, two in zip(read, SCANS, strict=True):
        assert np.array_equal(one.points, two.points)


@pytest.mark.parametrize("mcap", [False, True])
def test_one_of_several_topics_is_named(tmp_path, mcap):
    other = [(t + 0.001, "/other", message) for t, _, message in clouds()[:2]]
    bag = write_bag(tmp_path / "bag", clouds() + other, mcap=mcap)
    with pytest.raises(FormatError, match="several topics of type PointCloud2: /other, /points"):
        ScanFolder.find(bag)
    assert len(ScanFolder.find(bag, topics=["/other"])) == 2
    assert len(ScanFolder.find(bag, topics=["/points"])) == 4
    with pytest.raises(FormatError, match="did you mean '/points'"):
        ScanFolder.find(bag, topics=["/point"])


@pytest.mark.parametrize("mcap", [False, True])
def test_a_topic_without_messages_is_named_as_such(tmp_path, mcap):
    bag = write_bag(tmp_path / "bag", clouds(), mcap=mcap, silent=["/silent"])
    assert len(ScanFolder.find(bag)) == 4
    with pytest.raises(FormatError, match="topic '/silent' has no messages"):
        ScanFolder.find(bag, topics=["/silent"])
    bag = write_bag(tmp_path / "empty", [], mcap=mcap, silent=["/silent"])
    with pytest.raises(FormatError, match=r"got /silent \(.*PointCloud2, no messages\)"):
        ScanFolder.find(bag)


def test_stamps_of_the_recording_are_used_and_reported_where_headers_have_none(tmp_path):
    messages = clouds(late_s=0.0)
    for _, _, message in messages:
        message.header.stamp.sec = message.header.stamp.nanosec = 0
    read = ScanFolder.find(write_bag(tmp_path / "bag", messages))
    expected = [scan.stamp_s for scan in SCANS]
    assert np.array(read.stamps_s) - START_S == pytest.approx(expected, abs=1e-3)
    assert any("those of the recording are used" in note for note in read.notes)
    assert not any(
        "recording" in note
        for note in ScanFolder.find(write_bag(tmp_path / "stamped", clouds())).notes
    )


def test_topics_are_of_bags(tmp_path):
    np.save(tmp_path / "0.npy", np.ones((5, 3)))
    with pytest.raises(FormatError, match="topics are of a bag"):
        ScanFolder.find(tmp_path, topics=["/points"])


def test_a_bag_without_clouds_is_refused(tmp_path):
    bag = write_bag(tmp_path / "bag", [(0.0, "/imu", imu(0.0, (0, 0, 0), (0, 0, 9.8)))])
    with pytest.raises(FormatError, match="expected a topic of type PointCloud2, got /imu"):
        ScanFolder.find(bag)


def test_a_bag_of_ros_1_is_refused(tmp_path):
    (tmp_path / "old.bag").write_bytes(b"#ROSBAG V2.0\n")
    with pytest.raises(FormatError, match="rosbags-convert"):
        ScanFolder.find(tmp_path / "old.bag")


def test_a_damaged_message_is_an_empty_scan(tmp_path):
    messages = clouds()
    messages[2][2].data = messages[2][2].data[:-1000]
    read = ScanFolder.find(write_bag(tmp_path / "bag", messages))
    counts = [len(scan) for scan in read]
    assert counts == [len(SCANS[0]), len(SCANS[1]), 0, len(SCANS[3])]
    (error,) = read.losses.scans.values()
    assert "/points, message 2" in str(error)


@pytest.mark.parametrize("stray", [0, 2])
def test_a_scan_without_a_stamp_is_left_out_and_reported(tmp_path, stray):
    messages = clouds()
    stamp = messages[stray][2].header.stamp
    stamp.sec = stamp.nanosec = 0
    read = ScanFolder.find(write_bag(tmp_path / "bag", messages))
    stamped_scans = [scan for k, scan in enumerate(SCANS) if k != stray]
    assert np.array(read.stamps_s) - START_S == pytest.approx(
        [s.stamp_s for s in stamped_scans], abs=1e-3
    )
    assert [len(scan) for scan in read] == [len(scan) for scan in stamped_scans]
    assert any("1 scan is left out: stamps more than a day" in note for note in read.notes)


@pytest.mark.parametrize(
    ("back_s", "expected_error"), [(3600, "was set back"), (10**7, "of one clock")]
)
def test_a_clock_that_was_set_in_a_bag_is_refused(tmp_path, back_s, expected_error):
    messages = clouds()
    for _, _, message in messages[2:]:
        message.header.stamp.sec -= back_s
    with pytest.raises(FormatError, match=expected_error):
        ScanFolder.find(write_bag(tmp_path / "bag", messages))


def test_an_empty_message_does_not_hide_the_times_of_the_others(tmp_path):
    scan = SCANS[0]
    none = fields(scan, ring=scan.ring.astype("u2"), t=scan.time_offset_s)
    messages = clouds()
    messages[0] = (*messages[0][:2], cloud(0.0, {name: v[:0] for name, v in none.items()}))
    read = ScanFolder.find(write_bag(tmp_path / "bag", messages))
    assert np.array(read.stamps_s) - START_S == pytest.approx([s.stamp_s for s in SCANS], abs=2e-3)


@pytest.mark.parametrize("mcap", [False, True])
@pytest.mark.parametrize("share", [0.0, 0.01, 0.5, 0.999])
def test_bags_that_are_cut_off_are_refused(tmp_path, mcap, share):
    bag = write_bag(tmp_path / "bag", clouds(), mcap=mcap)
    file = next(bag.glob("*.mcap" if mcap else "*.db3"))
    file.write_bytes(file.read_bytes()[: int(share * file.stat().st_size)])
    for path in (bag, file):
        with pytest.raises(FormatError, match=re.escape(str(bag))):
            list(ScanFolder.find(path))


def test_an_extra_that_is_missing_is_named(tmp_path, uninstall):
    bag = write_bag(tmp_path / "bag", clouds())
    uninstall("rosbags")
    with pytest.raises(FormatError, match=r"rosbags is not installed: .*\[bags\]"):
        ScanFolder.find(bag)


def test_samples_of_an_imu(tmp_path):
    rng = np.random.default_rng(0)
    rates, forces = rng.normal(0, 0.1, (2, 20, 3))
    forces[:, 2] += 9.8
    messages = [(0.005 * k, "/imu", imu(0.005 * k, rates[k], forces[k])) for k in range(20)]
    messages[7][2].angular_velocity.x = float("nan")
    scans = ScanFolder.find(write_bag(tmp_path / "bag", [*messages, *clouds()]))
    samples, left_out = read_bag_imu(scans.bag)
    sample_indices = np.delete(np.arange(20), 7)
    assert left_out == 1
    assert np.array_equal(samples.angular_velocity, rates[sample_indices])
    assert np.array_equal(samples.specific_force, forces[sample_indices])
    assert samples.stamps_s - START_S == pytest.approx(0.005 * sample_indices, abs=1e-6)


@pytest.mark.parametrize("damage", ["cut off", "no stamp"])
def test_a_damaged_sample_is_left_out(tmp_path, damage):
    messages = [(0.005 * k, "/imu", imu(0.005 * k, (0, 0, k / 10), (0, 0, 9.8))) for k in range(20)]
    if damage == "no stamp":
        messages[7][2].header.stamp.sec = messages[7][2].header.stamp.nanosec = 0
    bag = write_bag(tmp_path / "bag", [*messages, *clouds()])
    if damage == "cut off":
        file = next(bag.glob("*.db3"))
        with closing(sqlite3.connect(file)) as base, base:
            command = "SELECT m.id, m.data FROM messages m JOIN topics t ON m.topic_id = t.id "
            rows = base.execute(f"{command} WHERE t.name = '/imu' ORDER BY m.timestamp").fetchall()
            row, data = rows[7]
            base.execute("UPDATE messages SET data = ? WHERE id = ?", (data[: len(data) // 2], row))
    samples, left_out = read_bag_imu(ScanFolder.find(bag).bag)
    assert left_out == 1
    assert samples.angular_velocity[:, 2].tolist() == [k / 10 for k in range(20) if k != 7]


def test_an_imu_in_g_is_refused(tmp_path):
    messages = [(0.01 * k, "/imu", imu(0.01 * k, (0, 0, 0), (0, 0, 1))) for k in range(20)]
    scans = ScanFolder.find(write_bag(tmp_path / "bag", [*messages, *clouds()]))
    with pytest.raises(FormatError, match="they may be in g"):
        read_bag_imu(scans.bag)


PIXELS = np.random.default_rng(0).integers(0, 256, (6, 8, 3), np.uint8)


@pytest.mark.parametrize(
    ("encoding", "pixels"),
    [
        ("rgb8", PIXELS),
        ("bgr8", PIXELS[..., ::-1]),
        ("bgra8", np.concatenate([PIXELS[..., ::-1], PIXELS[..., :1]], axis=2)),
    ],
)
def test_images(tmp_path, encoding, pixels):
    messages = [(0.1 * k, "/image", image(0.1 * k, pixels, encoding, gap=5)) for k in range(2)]
    images = ImageFolder.find(write_bag(tmp_path / "bag", messages))
    assert np.array_equal(images.read(1), PIXELS)
    assert images.size() == (8, 6)
    assert images.stamps(10.0).stamps_s[1] - START_S == pytest.approx(0.1, abs=1e-6)


def test_an_image_of_another_encoding_is_lost_and_reported(tmp_path):
    bag = write_bag(tmp_path / "bag", [(0.0, "/image", image(0.0, PIXELS, "bayer_rggb8"))])
    images = ImageFolder.find(bag)
    assert images.read(0) is None
    assert "bayer_rggb8" in str(next(iter(images.losses.values())))
