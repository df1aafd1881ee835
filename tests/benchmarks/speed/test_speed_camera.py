import pytest

from roadscope.benchmarks.speed import measure_camera


@pytest.mark.slow
def test_rows_of_a_rig_and_their_ratios() -> None:
    rows = {row.name.removesuffix(", 640 x 480"): row for row in measure_camera("wide", 1)}
    assert all(row.value > 0 for row in rows.values())
    drawn = {look: rows[f"images {look}"] for look in ("plain colours", "with everything")}
    assert {row.unit for row in drawn.values()} == {"images/s"}
    assert rows["everything over plain colours"].value == pytest.approx(
        drawn["plain colours"].value / drawn["with everything"].value
    )
    looked = {name: rows[f"network {name}"] for name in ("float32", "bf16")}
    assert rows["network float32 over bf16"].value == pytest.approx(
        looked["float32"].value / looked["bf16"].value
    )
    assert "colour-blobs" in rows
