"""QR codes in pictures, and where they hang: pictures that others took, and squares whose place is known."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st
from PIL import Image

from phalanx.errors import UsageError
from phalanx.mission.landmarks import codepose
from phalanx.mission.landmarks.codepose import Intrinsics, Mount, code_pose, qr_landmark
from phalanx.mission.landmarks.codes import read_codes

QR = Path(__file__).parent.parent / "data" / "qr"
PLAIN = Intrinsics(fx=1000.0, fy=1000.0, cx=640.0, cy=360.0, width=1280, height=720)
TEXTS = {
    "image01": ["http://www.facebook.com/LangersJuice"],
    "image02": ["ABC 123456789", "Version 1 QR", "Version 2 QR Code Test Image"],
    "image03": ["http://qrw.auvilfruit.com"],
    "image04": ["ABC 123456789", "Version 2 QR Code Test Image", "Version 1 QR"],
}


def grey(path):
    return np.array(Image.open(path).convert("L"))


def boofcv():
    words = yaml.safe_load((QR / "boofcv" / "intrinsic.yaml").read_text())
    pinhole, (k1, k2) = words["pinhole"], words["radial_tangential"]["radial"]
    return Intrinsics(k1=k1, k2=k2, **{key: value for key, value in pinhole.items() if key != "skew"})


def project(pose, size, camera=PLAIN):
    """Corners in pixels of a square with its middle at `pose[:3]`, turned by yaw, tilt and roll."""
    x, y, z, yaw, tilt, roll = pose
    half = size / 2
    square = np.array([(-half, -half, 0), (half, -half, 0), (half, half, 0), (-half, half, 0)])
    cy, sy, ct, st_, cr, sr = (f(a) for a in (yaw, tilt, roll) for f in (math.cos, math.sin))
    turn = (
        np.array([(cy, 0, sy), (0, 1, 0), (-sy, 0, cy)])
        @ np.array([(1, 0, 0), (0, ct, -st_), (0, st_, ct)])
        @ np.array([(cr, -sr, 0), (sr, cr, 0), (0, 0, 1)])
    )
    points = square @ turn.T + (x, y, z)
    flat = points[:, :2] / points[:, 2:]
    squared = (flat * flat).sum(1, keepdims=True)
    flat = flat * (1 + camera.k1 * squared + camera.k2 * squared**2)
    return flat * (camera.fx, camera.fy) + (camera.cx, camera.cy), turn[:, 2]


class TestPicturesOfOthers:
    @pytest.mark.parametrize("name", sorted(TEXTS))
    def test_every_code_of_boofcvs_pictures_is_read_and_placed(self, name):
        codes = read_codes(grey(QR / "boofcv" / f"{name}.jpg"))
        assert [code.text[:30] for code in codes] == [
            text[:30] if not text.startswith("ABC") else "ABC 123456789 ABC 123456789 AB" for text in TEXTS[name]
        ]
        for code in codes:
            pose = code_pose(code.corners_px, 0.12, boofcv())
            assert pose is not None
            assert 0.2 < pose.at_m[2] < 3
            # It is seen from the front.
            assert sum(a * b for a, b in zip(pose.normal, pose.at_m, strict=True)) > 0
            # The first one is wound around a bottle, and fits no plane.
            assert pose.error_px < (6 if name == "image01" else 2)

    def test_the_codes_on_one_board_lie_in_one_plane(self):
        """Three codes of different sizes on a clipboard: their normals agree, whatever their sizes are."""
        for name in ("image02", "image04"):
            normals = [
                np.array(code_pose(code.corners_px, 0.12, boofcv()).normal)
                for code in read_codes(grey(QR / "boofcv" / f"{name}.jpg"))
            ]
            small = [n for n in normals if n @ normals[-1] > math.cos(math.radians(10))]
            assert len(small) >= 2

    @pytest.mark.parametrize("path", sorted((QR / "zxing").glob("*.png")), ids=lambda path: path.stem)
    def test_zxings_samples_are_read(self, path):
        (code,) = read_codes(grey(path))
        assert code.text == path.with_suffix(".txt").read_bytes().decode()

    def test_a_picture_without_codes_shows_none(self):
        noise = np.random.default_rng(1).integers(0, 256, (480, 640), dtype=np.uint8)
        assert read_codes(noise) == ()
        assert read_codes(np.zeros((1, 1), np.uint8)) == ()

    def test_what_is_no_grey_picture_is_refused(self):
        for wrong in (np.zeros((4, 4, 3), np.uint8), np.zeros((4, 4)), np.zeros((0, 4), np.uint8)):
            with pytest.raises(UsageError):
                read_codes(wrong)


class TestPoses:
    @given(
        st.tuples(
            st.floats(-0.5, 0.5), st.floats(-0.3, 0.3), st.floats(0.4, 3.0),
            st.floats(-1.1, 1.1), st.floats(-0.8, 0.8), st.floats(-3.0, 3.0),
        )
    )  # fmt: skip
    @settings(deadline=None)
    def test_a_square_is_where_it_was_put(self, pose):
        corners, normal = project(pose, 0.12)
        found = code_pose(corners, 0.12, PLAIN)
        assert np.allclose(found.at_m, pose[:3], atol=1e-4)
        assert found.error_px < 0.01
        # The other tilt may look the same from far away; one of both is right.
        assert np.allclose(found.normal, normal, atol=0.02) or np.allclose(found.other_normal, normal, atol=0.02)

    def test_distortion_is_taken_out(self):
        camera = boofcv()
        corners, normal = project((0.2, 0.1, 0.5, 0.5, 0.2, 0.1), 0.12, camera)
        found = code_pose(corners, 0.12, camera)
        assert np.allclose(found.at_m, (0.2, 0.1, 0.5), atol=1e-4)
        assert np.allclose(found.normal, normal, atol=1e-3)

    def test_with_noise_the_error_grows_with_the_distance_and_the_doubt_is_told(self):
        random = np.random.default_rng(5)
        errors, sure = {}, {}
        for z in (0.6, 3.0):
            runs = []
            for _ in range(100):
                yaw = random.uniform(-0.9, 0.9)
                corners, normal = project((0.1, 0.0, z, yaw, 0, 0), 0.12)
                found = code_pose(corners + 0.3 * random.standard_normal((4, 2)), 0.12, PLAIN)
                runs.append(
                    (abs(found.at_m[2] - z), found.sure, math.degrees(math.acos(min(1.0, normal @ found.normal))))
                )
            errors[z] = np.median([run[0] for run in runs])
            sure[z] = np.mean([run[1] for run in runs])
            assert np.mean([run[2] < 25 for run in runs if run[1]]) > 0.9
        assert errors[0.6] < 0.005 < errors[3.0] < 0.1
        assert sure[0.6] > 0.8 > sure[3.0]

    @pytest.mark.parametrize(
        "corners",
        [
            [(0, 0)] * 4,
            [(0, 0), (1, 1), (2, 2), (3, 3)],
            [(math.nan, 0), (1, 0), (1, 1), (0, 1)],
            [(math.inf, 0), (1, 0), (1, 1), (0, 1)],
            [(1e300, 0), (1, 0), (1, 1), (0, 1)],
        ],
    )
    def test_what_is_no_square_has_no_pose(self, corners):
        assert code_pose(np.array(corners, float), 0.12, PLAIN) is None

    @given(st.lists(st.floats(-2000, 2000), min_size=8, max_size=8))
    @settings(deadline=None)
    def test_any_four_points_give_a_finite_pose_or_none(self, numbers):
        found = code_pose(np.array(numbers).reshape(4, 2), 0.12, PLAIN)
        assert found is None or all(map(math.isfinite, (*found.at_m, *found.normal, found.error_px)))

    @given(st.floats(-3, 3), st.floats(-1, 1), st.floats(-3, 3))
    def test_a_code_ahead_is_put_into_the_map_by_the_robots_pose(self, heading, yaw, turn):
        """Seen at camera (x right, z forward) = (0.2, 2), facing back along its own normal."""
        mount = Mount(x_m=0.1, y_m=-0.05, yaw_rad=yaw)
        normal = (math.sin(turn / 4), 0.0, math.cos(turn / 4))
        pose = codepose.CodePose((0.2, 0.0, 2.0), normal, 0.0, 9.0, (0.0, 0.0, -1.0))
        got = qr_landmark("a", pose, mount, 5.0, -3.0, heading)
        optical = heading + yaw
        eye = np.array(
            [
                5 + 0.1 * math.cos(heading) + 0.05 * math.sin(heading),
                -3 + 0.1 * math.sin(heading) - 0.05 * math.cos(heading),
            ]
        )
        ahead, right = (
            np.array([math.cos(optical), math.sin(optical)]),
            np.array([math.sin(optical), -math.cos(optical)]),
        )
        assert np.allclose((got.x_m, got.y_m), eye + 2 * ahead + 0.2 * right)
        into = normal[2] * ahead + normal[0] * right
        assert math.cos(got.orientation_rad - math.atan2(-into[1], -into[0])) == pytest.approx(1)

    def test_an_unsure_tilt_tells_no_orientation(self):
        pose = codepose.CodePose((0.0, 0.0, 3.0), (0.3, 0.0, 0.954), 0.2, 0.25, (-0.3, 0.0, 0.954))
        assert qr_landmark("a", pose, Mount(), 0, 0, 0).orientation_rad is None


def test_compiled_and_plain_poses_give_the_same_bits(monkeypatch):
    corners = np.array([project((0.1, -0.05, z, 0.3 * z, 0.1, 0.2), 0.12)[0] for z in (0.5, 1.0, 2.0, 3.5)])
    compiled = [code_pose(c, 0.12, boofcv()) for c in corners]
    for name in ("_normalised", "_first_guess", "_third_column", "_refine", "_solve", "_turn", "_pose"):
        monkeypatch.setattr(codepose, name, getattr(codepose, name).py_func)
    assert [code_pose(c, 0.12, boofcv()) for c in corners] == compiled


def test_lenses_that_are_none_are_refused():
    for wrong in ({"fx": 0.0}, {"cx": math.nan}, {"width": 0}):
        with pytest.raises(UsageError):
            Intrinsics(**{"fx": 1.0, "fy": 1.0, "cx": 0.0, "cy": 0.0, "width": 2, "height": 2, **wrong})
