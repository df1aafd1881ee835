"""PCD files that are compressed by LZF."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from roadscope.benchmarks.formats import decompress_lzf
from roadscope.formats import FormatError, read_pcd

SHORTEST, LONGEST, FARTHEST = 3, 264, 8192


def packed(content: bytes) -> bytes:
    """Compress as LZF does, by looking for the longest repetition everywhere."""
    out, literals, at = bytearray(), bytearray(), 0

    def flush() -> None:
        while literals:
            out.append(min(len(literals), 32) - 1)
            out.extend(literals[:32])
            del literals[:32]

    while at < len(content):
        length, back = 0, 0
        for start in range(max(0, at - FARTHEST), at):
            same = 0
            while (
                same < LONGEST
                and at + same < len(content)
                and content[start + same] == content[at + same]
            ):
                same += 1
            if same > length:
                length, back = same, at - start
        if length < SHORTEST:
            literals.append(content[at])
            at += 1
            continue
        flush()
        rest = length - 2
        high = (back - 1) >> 8
        out.extend([(rest << 5) | high] if rest < 7 else [(7 << 5) | high, rest - 7])
        out.append((back - 1) & 255)
        at += length
    flush()
    return bytes(out)


@given(st.lists(st.sampled_from([b"a", b"b", b"abcabc", b"\0" * 40, b"xyz"]), max_size=60))
def test_what_was_packed_comes_back(parts):
    content = b"".join(parts)
    back = decompress_lzf(np.frombuffer(packed(content), np.uint8), len(content))
    assert back.tobytes() == content


@given(st.binary(max_size=60), st.integers(0, 200))
def test_damaged_bytes_end_no_process(content, size):
    assert len(decompress_lzf(np.frombuffer(content, np.uint8), size)) <= size


def compressed(points: np.ndarray, rings: np.ndarray) -> bytes:
    head = (
        "VERSION .7\nFIELDS x y z ring\nSIZE 4 4 4 2\nTYPE F F F U\nCOUNT 1 1 1 1\n"
        f"WIDTH {len(points)}\nHEIGHT 1\nPOINTS {len(points)}\nDATA binary_compressed\n"
    ).encode()
    content = points.astype("<f4").T.tobytes() + rings.astype("<u2").tobytes()
    body = packed(content)
    return head + np.array([len(body), len(content)], "<u4").tobytes() + body


def test_points_come_back_and_a_cut_file_is_refused(tmp_path):
    points = np.random.default_rng(0).uniform(-30, 30, (60, 3)).round().astype(np.float32)
    rings = np.arange(60) % 16
    content = compressed(points, rings)
    (tmp_path / "0.pcd").write_bytes(content)
    fields = read_pcd(tmp_path / "0.pcd")
    assert np.array_equal(np.column_stack([fields[name] for name in "xyz"]), points)
    assert np.array_equal(fields["ring"], rings)
    (tmp_path / "0.pcd").write_bytes(content[:-9])
    with pytest.raises(FormatError, match="expected 60 compressed points of 14 bytes"):
        read_pcd(tmp_path / "0.pcd")
