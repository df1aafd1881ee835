import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from roadscope.benchmarks.formats import (
    CAMERA_FROM_EGO,
    bottoms_from_centres,
    box_corners,
    centres_from_bottoms,
    clipped_image_boxes,
    image_boxes,
    observation_angles,
    rotations_from_yaws,
    yaws_from_rotations,
)

P = np.array([[700.0, 0, 600, 45], [0, 700, 170, 0.2], [0, 0, 1, 0.003]])
PLACES = arrays(np.float64, (4, 3), elements=st.floats(-80, 80))
SIZES = arrays(np.float64, (4, 3), elements=st.floats(0.2, 20))
ANGLES = arrays(np.float64, 4, elements=st.floats(-10, 10))


def test_ahead_left_and_up_are_where_they_should_be():
    # 10 m ahead, 2 m to the right, the box standing 1.7 m below the camera
    centre = centres_from_bottoms(np.array([[2.0, 1.7, 10.0]]), np.array([[4.0, 1.8, 1.5]]))
    np.testing.assert_allclose(centre, [[10.0, -2.0, -1.7 + 0.75]])
    # rotation 0 looks along the camera's x, to the right: yaw -90 degrees
    np.testing.assert_allclose(yaws_from_rotations(np.array([0.0, -np.pi / 2])), [-np.pi / 2, 0])


@given(PLACES, SIZES)
def test_places_come_back(bottoms, sizes):
    back = bottoms_from_centres(centres_from_bottoms(bottoms, sizes), sizes)
    np.testing.assert_allclose(back, bottoms, atol=1e-12)


@given(ANGLES)
def test_angles_come_back_up_to_whole_turns(angles):
    turns = (rotations_from_yaws(yaws_from_rotations(angles)) - angles) / (2 * np.pi)
    np.testing.assert_allclose(turns, np.rint(turns), atol=1e-9)


@given(PLACES, SIZES, ANGLES)
def test_corners_are_those_of_the_box_in_our_own_frame(bottoms, sizes, angles):
    """KITTI's box_corners and ours, made from centre, yaw and size, are the same eight points."""
    centres, yaws = centres_from_bottoms(bottoms, sizes), yaws_from_rotations(angles)
    theirs = box_corners(bottoms, sizes, angles)
    for k in range(4):
        ours = []
        for a in (-0.5, 0.5):
            for b in (-0.5, 0.5):
                for c in (-0.5, 0.5):
                    x, y, z = np.array([a, b, c]) * sizes[k]
                    cosine, sine = np.cos(yaws[k]), np.sin(yaws[k])
                    turned = np.array([cosine * x - sine * y, sine * x + cosine * y, z])
                    ours.append(CAMERA_FROM_EGO.apply(centres[k] + turned))
        near = np.linalg.norm(np.array(ours)[:, None] - theirs[k][None], axis=-1).min(axis=1)
        np.testing.assert_allclose(near, 0, atol=1e-9)


@given(PLACES, SIZES, ANGLES)
def test_a_box_in_the_image_holds_what_the_camera_sees_of_it(bottoms, sizes, angles):
    """Points all over the box, those before the camera, project into its image box."""
    points = box_corners(bottoms, sizes, angles)
    boxes = image_boxes(points, P)
    weights = np.random.default_rng(0).dirichlet(np.full(8, 0.3), 200)
    inside = np.einsum("kw,nwc->nkc", weights, points)
    for box, cloud in zip(boxes, inside, strict=True):
        visible_points = cloud[cloud[:, 2] >= 0.2]
        flat = visible_points @ P[:, :3].T + P[:, 3]
        pixels = flat[:, :2] / flat[:, 2:]
        if len(visible_points):
            assert (pixels >= box[:2] - 1e-6).all()
            assert (pixels <= box[2:] + 1e-6).all()


def test_boxes_behind_the_camera_are_empty_and_others_clipped():
    size, turned = np.array([[4.0, 1.8, 1.5]]), np.array([0.0])
    behind = box_corners(np.array([[0.0, 1.7, -20.0]]), size, turned)
    aside = box_corners(np.array([[80.0, 1.7, 20.0]]), size, turned)
    assert np.isnan(image_boxes(behind, P)).all()
    for points in (behind, aside):
        left, top, right, bottom = clipped_image_boxes(points, P, (1200, 370))[0]
        assert right == left or bottom == top
    close = clipped_image_boxes(
        box_corners(np.array([[0.0, 1.7, 1.0]]), size, turned), P, (1200, 370)
    )[0]
    assert close[3] == 369


@pytest.mark.parametrize("place", [(-30, 1.5, 10), (30, 1.5, 10), (0, 30, 10), (0, -30, 10)])
def test_boxes_ahead_but_beside_the_image_have_no_height(place):
    """KITTI's evaluation leaves out low boxes, not narrow ones."""
    corners = box_corners(np.array([place]), np.array([[4.0, 1.7, 1.5]]), np.zeros(1))
    assert not clipped_image_boxes(corners, P, (1200, 370)).any()


def test_the_box_of_one_pixel_accuracy_by_hand():
    # a box 20 m ahead, straight: near face at 18 m, 1.8 m wide, 1.5 m high, standing at y = 1.7
    points = box_corners(
        np.array([[0.0, 1.7, 20.0]]), np.array([[4.0, 1.8, 1.5]]), np.array([-np.pi / 2])
    )
    plain = np.array([[700.0, 0, 600, 0], [0, 700, 170, 0], [0, 0, 1, 0]])
    box = image_boxes(points, plain)[0]
    expected = [
        600 - 700 * 0.9 / 18,
        170 + 700 * 0.2 / 22,
        600 + 700 * 0.9 / 18,
        170 + 700 * 1.7 / 18,
    ]
    np.testing.assert_allclose(box, expected)


def test_alpha_is_the_rotation_seen_from_the_camera():
    bottoms = np.array([[0.0, 1, 10], [10.0, 1, 10]])
    np.testing.assert_allclose(observation_angles(bottoms, np.zeros(2)), [0, -np.pi / 4])
