import pytest

from roadscope.benchmarks.speed import measure_camera


@pytest.mark.slow
def test_rows_of_a_rig_and_their_ratios() -> None:
    rows = {row.name.removesuffix(", 640 x 480"): row for row in measure_camera("wide", 1)}
    assert all(row.value > 0 for row in rows.values())
    drawn = {
        appearance: rows[f"images {appearance}"]
        for appearance in ("plain colours", "with everything")
    }
    assert {row.unit for row in drawn.values()} == {"images/s"}
    assert rows["everything over plain colours"].value == pytest.approx(
        drawn["plain colours"].value / drawn["with everything"].value
    )
    network_rows = {name: rows[f"network {name}"] for name in ("float32", "bf16")}
    assert rows["network float32 over bf16"].value == pytest.approx(
        network_rows["float32"].value / network_rows["bf16"].value
    )
    assert "colour-blobs" in rows
