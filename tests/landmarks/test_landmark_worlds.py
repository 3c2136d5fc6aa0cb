"""The world a mission robot lives in: rays, lidar, camera, wheels, people."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from landmark_world import NOBODY, ROOM
from phalanx.config.lidar import LidarConfig
from phalanx.errors import UsageError
from phalanx.mission.angles import wrap
from phalanx.mission.landmarks import FloorPlan, WallCode
from phalanx.mission.landmarks import lidar as raycast
from phalanx.mission.landmarks.codepose import Intrinsics
from phalanx.mission.landmarks.codes import read_codes
from phalanx.mission.landmarks.lidar import Beams, Lidar, packed_beams
from phalanx.mission.landmarks.scan import beam_table
from phalanx.robot.controllers.mission.evidence import codes_at
from phalanx.world.building.camera import Camera, CameraConfig
from phalanx.world.building.floorplan import load_floorplan
from phalanx.world.building.odometry import DiffDrive, DiffDriveConfig, NoiseModel, Odometry, OdometryNoise, along_arc
from phalanx.world.building.walkers import ROOM_M, Walkers, free_place

COORDINATE = st.floats(-20, 20).map(lambda x: round(x, 3))


def all_pairs(pose, walls, discs, beams, first, step, reach):
    """Every ray against everything, by another formula."""
    x, y, heading = pose
    ranges = np.full(beams, math.inf)
    for k in range(beams):
        dx, dy = math.cos(heading + first + k * step), math.sin(heading + first + k * step)
        for ax, ay, bx, by in walls:
            system = np.array([[dx, ax - bx], [dy, ay - by]])
            if abs(np.linalg.det(system)) > 1e-9:
                t, s = np.linalg.solve(system, [ax - x, ay - y])
                if t > 0 and 0 <= s <= 1:
                    ranges[k] = min(ranges[k], t)
        for cx, cy, radius in discs:
            along = (cx - x) * dx + (cy - y) * dy
            off = radius**2 - (cx - x) ** 2 - (cy - y) ** 2 + along**2
            if off > 0 and along > 0 and math.hypot(cx - x, cy - y) > radius:
                ranges[k] = min(ranges[k], along - math.sqrt(off))
    ranges[ranges > reach] = math.inf
    return ranges


class TestRays:
    @given(
        st.lists(st.tuples(COORDINATE, COORDINATE, COORDINATE, COORDINATE), max_size=6),
        st.lists(st.tuples(COORDINATE, COORDINATE, st.floats(0.1, 1)), max_size=3),
        st.floats(-7, 7),
        st.sampled_from([(1.5 * math.pi, -0.75 * math.pi), (2 * math.pi, -math.pi), (2 * math.pi, 0.0), (0.5, 2.9)]),
    )
    @settings(deadline=None)
    def test_rays_meet_what_every_pair_says(self, walls, discs, heading, sweep):
        (fov, first), beams, pose = sweep, 60, (0.123, -0.456, heading)
        step = fov / beams
        ranges = np.empty(beams)
        walls, discs = np.array(walls, float).reshape(-1, 4), np.array(discs, float).reshape(-1, 3)
        raycast.cast(
            pose,
            raycast.tiles_of(walls),
            discs,
            packed_beams(Beams(first, step, *beam_table(first, step, beams), 15.0)),
            ranges,
        )
        expected = all_pairs(pose, walls, discs, beams, first, step, 15.0)
        # A ray through exactly the end of a wall or along it, or at exactly the range, may go either way; and a disc
        # that is met at exactly the range has a ray on each side.
        with np.errstate(invalid="ignore"):
            apart = ~((ranges == expected) | (np.abs(ranges - expected) < 1e-6))
        assert apart.sum() <= 1 + 2 * len(discs)

    def test_no_ray_slips_between_walls_that_touch(self):
        angles = np.linspace(0, 2 * math.pi, 200)
        ring = np.column_stack([np.cos(angles[:-1]), np.sin(angles[:-1]), np.cos(angles[1:]), np.sin(angles[1:])]) * 5
        lidar = Lidar(ring, LidarConfig(noise_m=0, drop_out=0, beams=4000, fov_rad=2 * math.pi))
        for heading in np.linspace(-3, 3, 50):
            ranges = lidar.true_ranges((0.3, -0.2, float(heading)))
            assert np.isfinite(ranges).all()
            assert ranges.max() < 5.4

    def test_compiled_and_plain_rays_give_the_same_bits(self, monkeypatch):
        lidar = Lidar(np.array(ROOM, float), LidarConfig(noise_m=0, drop_out=0, beams=180))
        discs = np.array([[3.0, 1.0, 0.3]])
        compiled = lidar.true_ranges((2.5, 1.9, 0.4), discs)
        for name in ("_span", "_cast_wall", "_cast_disc"):
            monkeypatch.setattr(raycast, name, getattr(raycast, name).py_func)
        plain = np.empty(180)
        config = lidar.config
        first, step = config.angle_min_rad, config.angle_increment_rad
        beams = Beams(first, step, *beam_table(first, step, 180), 30.0)
        raycast.cast.py_func((2.5, 1.9, 0.4), raycast.tiles_of(np.array(ROOM, float)), discs, beams, plain)
        assert compiled.tobytes() == plain.tobytes()


class TestLidar:
    def test_noise_and_drop_outs_are_as_configured_and_follow_the_seed(self):
        lidar = Lidar(np.array(ROOM, float), LidarConfig(noise_m=0.02, drop_out=0.1))
        pose = (2.5, 1.9, 0.4)
        scans = [lidar.sweep(pose, np.random.default_rng(seed)).ranges_m for seed in (1, 1, 2)]
        assert scans[0].tobytes() == scans[1].tobytes() != scans[2].tobytes()
        assert np.isnan(scans[0]).mean() == pytest.approx(0.1, abs=0.04)
        assert np.nanstd(scans[0] - lidar.true_ranges(pose)) == pytest.approx(0.02, rel=0.2)

    def test_beyond_its_range_it_misses(self):
        lidar = Lidar(np.array([(5, -9, 5, 9)], float), LidarConfig(range_max_m=4.9, noise_m=0, drop_out=0))
        assert np.isposinf(lidar.sweep((0, 0, 0), np.random.default_rng(0)).ranges_m).all()

    def test_a_world_without_walls_is_seen_as_one(self):
        assert np.isposinf(Lidar(np.zeros((0, 4))).true_ranges((0, 0, 0))).all()

    def test_a_person_is_seen_in_front_of_a_wall(self):
        lidar = Lidar(np.array([(5, -9, 5, 9)], float), LidarConfig(noise_m=0, drop_out=0))
        ranges = lidar.true_ranges((0, 0, 0), np.array([[2.0, 0.0, 0.25]]))
        assert ranges[540] == pytest.approx(1.75, abs=1e-3)
        assert ranges[640] == pytest.approx(5 / math.cos(100 * lidar.config.angle_increment_rad))

    def test_settings_out_of_range_are_refused(self):
        for wrong in ({"beams": 1}, {"fov_rad": 7.0}, {"noise_m": math.nan}, {"range_min_m": 5, "range_max_m": 5}):
            with pytest.raises(UsageError):
                LidarConfig(**wrong)


def drive(noise, seed, steps=200):
    """Estimated and true end of a way of 20 m that turns by 2 rad."""
    odometry = Odometry((0, 0, 0), noise, np.random.default_rng(seed))
    true = (0.0, 0.0, 0.0)
    for _ in range(steps):
        odometry.step(0.1, 0.01)
        true = along_arc(true, 0.1, 0.01)
    return odometry, true


class TestOdometry:
    def test_without_noise_it_is_right(self):
        odometry, true = drive(OdometryNoise(0, 0), 1)
        assert np.allclose(odometry.pose, true)
        assert odometry.travelled_m == pytest.approx(20)

    def test_an_arc_ends_where_its_circle_says(self):
        assert np.allclose(along_arc((1, 2, 0), math.pi, math.pi), (1, 4, wrap(math.pi)))
        assert np.allclose(along_arc((1, 2, 0), math.pi / 2, math.pi / 2), (2, 3, math.pi / 2))
        assert np.allclose(along_arc((0, 0, 1), 2, 0), (2 * math.cos(1), 2 * math.sin(1), 1))

    def test_stages_factor_is_drawn_once_within_half_a_sigma(self):
        ways = [drive(OdometryNoise(0.1, 0), seed)[0].travelled_m / 20 - 1 for seed in range(300)]
        assert max(map(abs, ways)) <= 0.05
        assert np.std(ways) == pytest.approx(0.1 / math.sqrt(12), rel=0.15)

    def test_the_fixed_factor_is_sigma(self):
        odometry, _ = drive(OdometryNoise(0.06, 0.05, NoiseModel.FIXED), 1)
        assert odometry.travelled_m == pytest.approx(20 * 1.06)
        assert odometry.pose[2] == pytest.approx(2 * 1.05)

    def test_factors_drawn_at_every_step_even_out(self):
        ways = [drive(OdometryNoise(0.1, 0, NoiseModel.STEP), seed)[0].travelled_m for seed in range(200)]
        assert np.std(ways) == pytest.approx(0.1 * 0.1 * math.sqrt(200), rel=0.2)

    def test_a_correction_is_where_it_goes_on(self):
        odometry, _ = drive(OdometryNoise(0, 0), 1)
        odometry.correct((5.0, 6.0, 0.0))
        assert odometry.step(1.0, 0.0) == (6.0, 6.0, 0.0)

    @pytest.mark.parametrize(
        ("text", "noise"),
        [
            ("0.03,0.05", OdometryNoise(0.03, 0.05, NoiseModel.STAGE)),
            ("0.06,0,fixed", OdometryNoise(0.06, 0, NoiseModel.FIXED)),
            ("0,0,step", OdometryNoise(0, 0, NoiseModel.STEP)),
        ],
    )
    def test_noise_is_written_as_on_the_command_line(self, text, noise):
        assert OdometryNoise.parse(text) == noise

    @pytest.mark.parametrize("text", ["", "1", "a,b", "0.1,0.1,gauss", "0.1,0.1,step,1", "-1,0", "nan,0"])
    def test_other_words_are_refused(self, text):
        with pytest.raises(UsageError):
            OdometryNoise.parse(text)


class TestDriving:
    PLAN = FloorPlan("room", np.array(ROOM, float), (), (0.0, 0.0, 12.0, 4.0))

    def test_it_drives_where_its_wheels_turn(self):
        robot = DiffDrive(self.PLAN, (2.0, 2.0, 0.0))
        for _ in range(10):
            assert robot.step(*robot.wheels(0.5, 0.0), 0.1) == pytest.approx((0.05, 0.0))
        assert np.allclose(robot.pose, (2.5, 2.0, 0.0))
        robot.step(*robot.wheels(0.0, 1.0), 0.5)
        assert np.allclose(robot.pose, (2.5, 2.0, 0.5))

    def test_a_speed_beyond_its_wheels_keeps_the_curve(self):
        robot = DiffDrive(self.PLAN, (2.0, 2.0, 0.0), DiffDriveConfig(wheel_max_mps=0.3))
        left, right = robot.wheels(1.0, 2.0)
        assert max(left, right) == pytest.approx(0.3)
        assert (right - left) / (0.5 * (right + left)) == pytest.approx(0.16 * 2.0)

    def test_a_wall_stops_it_and_its_wheels_slip(self):
        robot = DiffDrive(self.PLAN, (5.0, 0.5, 0.0))
        way = sum(robot.step(0.5, 0.5, 0.1)[0] for _ in range(60))
        assert way == pytest.approx(3.0)
        assert 5.7 < robot.pose[0] <= 6 - 0.175
        for _ in range(20):
            robot.step(-0.5, -0.5, 0.1)
        assert robot.pose[0] < 5.0

    def test_a_broken_wheel_bends_its_way_and_odometry_does_not_see_it(self):
        robot = DiffDrive(self.PLAN, (1.0, 2.0, 0.0))
        robot.left = 0.9
        for _ in range(10):
            assert robot.step(0.4, 0.4, 0.1)[1] == 0
        assert robot.pose[2] == pytest.approx(0.1 * 0.4 / 0.16)


class TestPeople:
    def test_they_walk_and_never_through_walls(self):
        plan = load_floorplan("office_40x40")
        walkers = Walkers(plan, 12, np.random.default_rng(3))
        first = walkers.discs
        for _ in range(200):
            before = walkers.discs
            walkers.step(0.1)
            for (x, y, _), (x2, y2, _) in zip(before, walkers.discs, strict=True):
                assert plan.sees((x, y), (x2, y2))
                assert plan.clearance_m(x2, y2) >= ROOM_M
                assert math.hypot(x2 - x, y2 - y) <= 0.1401
        assert np.hypot(*(walkers.discs - first)[:, :2].T).mean() > 2

    def test_where_there_is_no_room_nobody_walks(self):
        plan = FloorPlan(
            "cell",
            np.array([(0, 0, 1, 0), (1, 0, 1, 0.5), (1, 0.5, 0, 0.5), (0, 0.5, 0, 0)], float),
            (),
            (0, 0, 1, 0.5),
        )
        with pytest.raises(UsageError, match="room"):
            free_place(plan, 0.4, np.random.default_rng(1))
        assert Walkers(plan, 0, np.random.default_rng(1)).discs.shape == (0, 3)


CODES = (WallCode("phalanx:a", 6.0, 0.6, 0.3, math.pi), WallCode("phalanx:b", 3.0, 4.0, 0.35, -math.pi / 2))
HALL = FloorPlan("hall", np.array(ROOM, float), (), (0.0, 0.0, 12.0, 4.0), None, CODES)


class TestCamera:
    def look(self, pose, people=NOBODY, camera=None, **more):
        camera = camera or Camera(HALL, CameraConfig(**more.pop("config", {})))
        codes = read_codes(camera.picture(pose, np.random.default_rng(2), people, **more))
        return codes_at(camera.eye, pose, codes)

    def test_a_code_is_read_and_put_where_it_hangs(self):
        for pose in ((4.5, 0.5, 0.0), (4.6, 1.2, -0.4), (5.2, 0.5, 0.1)):
            (code,) = self.look(pose)
            assert code.text == "phalanx:a"
            assert math.hypot(code.x_m - 6, code.y_m - 0.6) < 0.01
            assert code.orientation_rad is None or abs(math.remainder(code.orientation_rad - math.pi, math.tau)) < 0.15

    def test_a_wrong_pose_puts_it_wrong_by_as_much(self):
        camera = Camera(HALL)
        seen = read_codes(camera.picture((4.5, 0.5, 0.0), np.random.default_rng(2)))
        (code,) = codes_at(camera.eye, (4.7, 0.4, 0.0), seen)
        assert (code.x_m, code.y_m) == pytest.approx((6.2, 0.5), abs=0.01)

    def test_it_is_not_seen_from_behind_nor_through_walls_nor_through_people(self):
        assert not self.look((7.5, 0.6, math.pi))
        assert not self.look((4.5, 0.5, 0.0), np.array([[5.3, 0.55, 0.25]]))
        assert self.look((4.5, 0.5, 0.0), np.array([[5.3, 1.5, 0.25]]))
        wall = FloorPlan("hall", np.array([*ROOM, (5.5, 0, 5.5, 4)], float), (), HALL.bounds, None, CODES)
        assert not self.look((4.5, 0.5, 0.0), camera=Camera(wall))

    def test_in_the_dark_and_in_a_blur_it_is_not_read(self):
        assert not self.look((4.5, 0.5, 0.0), config={"light": (0.0, 0.0)})
        assert not self.look((4.5, 0.5, 0.0), config={"exposure_s": 0.05}, turn_radps=2.0)

    def test_a_picture_follows_the_seed(self):
        pictures = [Camera(HALL).picture((4.5, 0.5, 0.0), np.random.default_rng(seed)) for seed in (1, 1, 2)]
        assert pictures[0].tobytes() == pictures[1].tobytes() != pictures[2].tobytes()

    def test_settings_out_of_range_are_refused(self):
        bent = Intrinsics(fx=500.0, fy=500.0, cx=1.0, cy=1.0, width=3, height=3, k1=0.1)
        for wrong in ({"noise_grey": -1}, {"light": (9.0, 1.0)}, {"intrinsics": bent}):
            with pytest.raises(UsageError):
                CameraConfig(**wrong)


# Nobody looks along a wall: what a beam meets there is for rounding to say.
PLACE = 0.0123457, -0.0345679
steps = st.integers(-60, 60)
walls_drawn = st.lists(st.tuples(steps, steps, st.integers(-9, 9), st.integers(-9, 9)), min_size=1, max_size=60)


@given(walls_drawn, st.floats(-3.2, 3.2))
def test_walls_in_tiles_are_seen_as_one_after_the_other(drawn, heading):
    walls = np.array([(ax, ay, ax + dx, ay + dy) for ax, ay, dx, dy in drawn if dx or dy], float).reshape(-1, 4) / 10
    config, pose = LidarConfig(beams=90), (*PLACE, heading)
    alone = [Lidar(wall, config).true_ranges(pose) for wall in walls]
    assert np.array_equal(Lidar(walls, config).true_ranges(pose), np.min([np.full(90, np.inf), *alone], axis=0))
