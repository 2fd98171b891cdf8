"""Synthetic sequences: seeded, exact, and showing what was asked for."""

import numpy as np
import pytest

from entrack.box import iou, to_corners
from entrack.datasets import open_dataset
from entrack.datasets.synthetic import (
    ATTRIBUTES,
    Film,
    Props,
    Scene,
    configure,
    hard,
    motion,
    sample,
    sprite,
    synthesise,
    texture,
    write,
)
from entrack.datasets.synthetic.actor import around
from entrack.errors import EntrackError

SMALL = {"width": 240, "height": 180, "target_size": 36.0}


def scene_of(**values) -> Scene:
    film = synthesise(configure(**{**SMALL, **values})).frames
    assert isinstance(film, Film)
    return film.scene


def sides(boxes):
    return np.sqrt(boxes[:, 2] * boxes[:, 3])


def steps(boxes):
    centres = boxes[:, :2] + boxes[:, 2:] / 2
    return np.hypot(*np.diff(centres, axis=0).T)


def tight_box(alpha, corner):
    """The slow way: the first and the last row and column that are half covered."""
    rows, columns = (np.flatnonzero((alpha >= 0.5).any(axis=axis)) for axis in (1, 0))
    x, y = columns[0] + corner[0], rows[0] + corner[1]
    return np.array([x, y, columns[-1] - columns[0] + 1, rows[-1] - rows[0] + 1], float)


def test_a_sequence_has_the_shapes_and_types_that_all_datasets_have():
    sequence = synthesise(configure(**SMALL, length=7, scale=1.5), name="one")
    assert (sequence.name, len(sequence), len(sequence.frames)) == ("one", 7, 7)
    assert sequence.frames[0].shape == (180, 240, 3)
    assert sequence.frames[0].dtype == np.uint8
    assert sequence.boxes.shape == (7, 4)
    assert sequence.boxes.dtype == np.float64
    assert sequence.absent.dtype == bool
    assert sequence.attributes == ("SV",)
    assert sequence.size == (240, 180)
    with pytest.raises(IndexError):
        sequence.frames[7]
    assert len(list(sequence.frames)) == 7


def test_the_same_seed_gives_the_same_pictures_and_boxes_and_another_seed_others():
    config = sample(5, ["camera_motion", "lookalikes", "illumination"], **SMALL, length=30)
    one, two = synthesise(config), synthesise(config)
    np.testing.assert_array_equal(one.boxes, two.boxes)
    for t in (0, 13, 29):
        np.testing.assert_array_equal(one.frames[t], two.frames[t])
    other = synthesise(configure(seed=6, **SMALL, length=30))
    assert (one.frames[0] != other.frames[0]).mean() > 0.5
    assert not np.allclose(one.boxes[0], other.boxes[0])


@pytest.mark.parametrize("name", ["motion_blur", "full_occlusion", "deformation"])
def test_a_frame_does_not_depend_on_those_rendered_before(name):
    config = sample(2, [name], **SMALL, length=60)
    in_order = [frame.copy() for frame in synthesise(config).frames]
    at_random = synthesise(config).frames
    for t in (41, 3, 59, 3):
        np.testing.assert_array_equal(at_random[t], in_order[t])
    np.testing.assert_array_equal(at_random[-1], in_order[59])


@pytest.mark.parametrize(
    "values",
    [
        {"scale": 3.0, "target_size": 24.0},
        {"rotation": 1.0},
        {"aspect_change": 3.0},
        {"deformation": 0.06},
        {"camera_motion": 0.1, "rotation": 0.5, "scale": 1.8},
        {"target_size": 12.0},
    ],
)
def test_boxes_are_tight_around_the_rendered_shape(values):
    scene = scene_of(seed=3, length=40, **values)
    for t in range(0, 40, 3):
        region = around(scene.boxes[t])
        alpha = scene.actors[scene.target].alpha(t, scene.view(t), region)
        # Half a pixel of rounding, and a little for what resampling softens.
        tight = to_corners(tight_box(alpha, region[:2]))
        np.testing.assert_allclose(to_corners(scene.boxes[t]), tight, atol=0.75)


def test_boxes_tell_where_the_pixels_are():
    """The difference that a dyed target makes to a picture lies in its box and fills it."""
    scene = scene_of(seed=8, length=20, noise=0, rotation=0.3)
    actor = scene.actors[scene.target]
    dyed = Scene(
        scene.width,
        scene.height,
        scene.background,
        scene.camera,
        (type(actor)(actor.sprite.tinted(np.zeros(3)), actor.poses, actor.pictures, actor.layer),),
        0,
        scene.light,
    )
    for t in (0, 10, 19):
        changed = np.abs(scene.render(t).astype(int) - dyed.render(t)).max(axis=2) > 24
        found = tight_box(changed.astype(float), (0, 0))
        assert iou(found, scene.boxes[t]) > 0.8


def test_an_easy_sequence_keeps_its_target_in_view_at_the_asked_size_and_pace():
    for seed in range(6):
        config = configure(seed=seed, **SMALL, length=80, speed=0.05)
        scene = scene_of(seed=seed, length=80, speed=0.05)
        assert sides(scene.boxes)[0] == pytest.approx(36, rel=0.03)
        assert scene.visible.min() > 0.98
        assert 0.02 < (steps(scene.boxes) / config.target_size).mean() < 0.09
        assert (steps(scene.boxes) / config.target_size).max() < 0.15


def test_scale_and_aspect_reach_what_was_asked_smoothly():
    for seed in range(4):
        size = sides(scene_of(seed=seed, scale=2.2, length=120).boxes)
        change = np.exp(np.abs(np.log(size / size[0])).max())
        assert change == pytest.approx(2.2, rel=0.08)
        assert np.abs(np.diff(np.log(size))).max() < 0.08
        boxes = scene_of(seed=seed, aspect_change=2.5, length=120).boxes
        ratio = boxes[:, 2] / boxes[:, 3]
        assert np.exp(np.abs(np.log(ratio / ratio[0])).max()) > 1.9


def test_rotation_turns_the_target_as_far_as_asked():
    poses = scene_of(seed=1, rotation=0.5, length=100).actors[0].poses
    assert np.abs(poses[:, 4] - poses[0, 4]).max() == pytest.approx(np.pi, abs=0.1)


def test_fast_motion_has_bursts_of_the_asked_speed_between_calm():
    for seed in range(4):
        scene = scene_of(seed=seed, fast_motion=0.8, length=120, target_size=24, events=2)
        pace = steps(scene.boxes) / sides(scene.boxes)[1:]
        assert 0.5 < pace.max() < 0.9
        assert np.median(pace) < 0.1


@pytest.mark.parametrize("frames", [10, 25])
def test_a_full_occlusion_hides_every_pixel_for_the_asked_frames_and_ends(frames):
    for seed in range(4):
        scene = scene_of(seed=seed, full_occlusion=frames, length=120, camera_motion=0.03)
        assert frames <= scene.absent.sum() <= 1.5 * frames + 4
        assert not scene.absent[:6].any()
        assert scene.visible[-1] > 0.6
        # The picture agrees: without its target it looks the same while the target is hidden.
        empty = Scene(
            scene.width,
            scene.height,
            scene.background,
            scene.camera,
            scene.actors[1:],
            0,
            scene.light,
            noise=scene.noise,
            seed=scene.seed,
        )
        hidden, seen = int(np.flatnonzero(scene.absent)[frames // 2]), 0
        for t, same in ((hidden, True), (seen, False)):
            x, y, w, h = scene.boxes[t].round().astype(int)
            with_target = scene.render(t)[y : y + h, x : x + w].astype(int)
            without = empty.render(t)[y : y + h, x : x + w]
            assert (np.abs(with_target - without).mean() < 1) == same


def test_a_partial_occlusion_hides_about_the_asked_share_and_no_more():
    for seed in range(6):
        scene = scene_of(seed=seed, partial_occlusion=0.5, length=100)
        assert 0.33 < scene.visible.min() < 0.67
        assert not scene.absent.any()
        assert scene.visible[[0, -1]].min() > 0.95


def test_out_of_view_leaves_the_picture_for_the_asked_frames_and_returns():
    for seed in range(4):
        scene = scene_of(seed=seed, out_of_view=15, length=120)
        gone = scene.absent
        assert 15 <= gone.sum() <= 27
        x, _, w, _ = scene.boxes[gone].T
        assert ((x + w < 2) | (x > scene.width - 2)).all()
        assert scene.visible[-1] > 0.6
        assert np.isfinite(scene.boxes).all()


def test_visible_is_the_share_of_the_shape_that_the_slow_way_finds():
    scene = scene_of(seed=4, partial_occlusion=0.6, lookalikes=2, length=100)
    t = int(scene.visible.argmin())
    region = (0, 0, scene.width, scene.height)
    shapes = [actor.alpha(t, scene.view(t), region) for actor in scene.actors]
    shown = shapes[0].copy()
    for actor, shape in zip(scene.actors[1:], shapes[1:], strict=True):
        if actor.layer[t] >= scene.actors[0].layer[t]:
            shown *= 1 - shape
    assert scene.visible[t] == pytest.approx(shown.sum() / shapes[0].sum(), abs=0.01)


def test_events_repeat():
    scene = scene_of(seed=2, full_occlusion=8, events=3, length=240)
    starts = np.flatnonzero(np.diff(scene.absent.astype(int)) == 1)
    assert len(starts) == 3


def test_lookalikes_look_like_the_target_come_close_and_are_never_the_label():
    for seed in range(4):
        scene = scene_of(seed=seed, lookalikes=3, length=120)
        assert len(scene.actors) == 4
        label = scene.boxes
        for copy in range(1, 4):
            boxes = scene.boxes_of(scene.actors[copy])
            distance = np.hypot(*(boxes[:, :2] - label[:, :2]).T) / 36
            assert distance[0] > 1
            assert distance.min() < 2
            assert iou(boxes[0], label[0]) == 0
            assert sides(boxes)[0] == pytest.approx(36, rel=0.25)
            own, other = (scene.actors[a].sprite.pictures[0][0] for a in (scene.target, copy))
            alpha = own[..., 3] > 200
            difference = np.abs(own.astype(int) - other)[alpha][:, :3].mean()
            assert 0 < difference < 40


def test_illumination_changes_the_light_and_nothing_else():
    values = {"seed": 5, "length": 60, "noise": 0}
    plain, lit = scene_of(**values), scene_of(**values, illumination=0.6)
    np.testing.assert_array_equal(plain.boxes, lit.boxes)
    brightness = np.array([[s.render(t).mean() for t in range(0, 60, 3)] for s in (plain, lit)])
    ratio = brightness[1] / brightness[0]
    assert ratio.min() == pytest.approx(0.4, abs=0.12)
    assert ratio.max() > 0.75
    assert np.ptp(brightness[0]) < 3


def test_motion_blur_smears_fast_things_only():
    values = {"seed": 5, "length": 40, "noise": 0, "speed": 0.25}
    sharp, blurred = scene_of(**values), scene_of(**values, motion_blur=1.0)
    np.testing.assert_array_equal(sharp.boxes, blurred.boxes)
    t = int(steps(sharp.boxes).argmax())

    def contrast(scene, box):
        x, y, w, h = box.round().astype(int)
        part = scene.render(t)[y : y + h, x : x + w].astype(float)
        return np.abs(np.diff(part, axis=1)).mean() + np.abs(np.diff(part, axis=0)).mean()

    assert contrast(blurred, sharp.boxes[t]) < 0.75 * contrast(sharp, sharp.boxes[t])
    far = np.array([2, 2, 30, 30]) if sharp.boxes[t, 0] > 120 else np.array([200, 2, 30, 30])
    assert contrast(blurred, far) == pytest.approx(contrast(sharp, far), rel=0.05)


def test_camera_motion_moves_the_background():
    still, moving = scene_of(seed=5, length=40), scene_of(seed=5, length=40, camera_motion=0.15)
    corner = np.s_[:20, :20]
    for scene, changes in ((still, False), (moving, True)):
        first, last = scene.render(0)[corner].astype(int), scene.render(39)[corner]
        assert (np.abs(first - last).mean() > 6) == changes
        assert scene.visible.min() > 0.9


def test_low_resolution_loses_detail():
    fine, coarse = (scene_of(seed=5, length=2, noise=0, low_resolution=k) for k in (1, 3))
    sharpness = [np.abs(np.diff(s.render(0).astype(int), axis=1)).mean() for s in (fine, coarse)]
    assert sharpness[1] < 0.8 * sharpness[0]


def test_deformation_changes_the_shape_without_cutting_it():
    scene = scene_of(seed=5, length=60, deformation=0.08)
    ratio = scene.boxes[:, 2] / scene.boxes[:, 3]
    assert np.ptp(ratio) > 0.05
    assert np.abs(np.diff(ratio)).max() < 0.1
    for levels in scene.actors[0].sprite.shapes:
        assert levels[0][[0, -1]].max() == levels[0][:, [0, -1]].max() == 0


def test_given_pictures_are_used():
    red, blue = np.zeros((90, 120, 3), np.uint8), np.zeros((90, 120, 3), np.uint8)
    red[..., 2], blue[..., 0] = 200, 200
    sequence = synthesise(configure(**SMALL, noise=0), Props(backgrounds=[blue], textures=[red]))
    frame = sequence.frames[0]
    x, y, w, h = sequence.boxes[0]
    assert frame[int(y + h / 2), int(x + w / 2), 2] > 80
    assert frame[2, 2].tolist() == [200, 0, 0]


def test_every_attribute_can_be_sampled_and_is_named():
    for seed, (name, code) in enumerate(ATTRIBUTES.items()):
        sequence = synthesise(sample(seed, [name], length=90, width=320, height=240))
        assert sequence.attributes == (code,)
        assert sequence.frames[45].shape == (240, 320, 3)


def test_random_configurations_work_for_short_clips_too():
    shown = set()
    for seed in range(25):
        shown.update(synthesise(sample(seed, length=40, width=256, height=192)).attributes)
    assert len(shown) > 8


def test_the_hard_suite_is_fixed_and_holds_what_it_says():
    first = list(hard(6))
    again = list(hard(2))
    np.testing.assert_array_equal(first[1].boxes, again[1].boxes)
    assert len({sequence.name for sequence in first}) == 6
    for sequence in first:
        gone = int(sequence.absent.sum())
        assert ("FOC" in sequence.attributes or "OV" in sequence.attributes) == (gone >= 10)
        assert not sequence.absent[[0, -1]].any()
    assert {code for s in first for code in s.attributes} == {"FOC", "OV", "BC"}


def test_written_sequences_read_back_as_they_were(tmp_path):
    sequences = [synthesise(sample(seed, ["out_of_view"], **SMALL, length=60)) for seed in (1, 2)]
    assert write(iter(sequences), tmp_path / "out") == [s.name for s in sequences]
    folder = tmp_path / "out" / sequences[0].name
    assert len(list(folder.glob("*.jpg"))) == 60
    rows = np.loadtxt(folder / "groundtruth.txt", delimiter=",")
    np.testing.assert_allclose(rows - (1, 1, 0, 0), sequences[0].boxes, atol=1e-4)
    np.testing.assert_array_equal(np.loadtxt(folder / "absence.label"), sequences[0].absent)
    listed = (tmp_path / "out" / "list.txt").read_text().split()
    assert listed == [s.name for s in sequences]
    read = open_dataset(f"got10k:{tmp_path / 'out'}")[0]
    seen = ~sequences[0].absent
    np.testing.assert_array_equal(read.absent, sequences[0].absent)
    np.testing.assert_allclose(read.boxes[seen], sequences[0].boxes[seen], atol=1e-3)
    assert read.size == (240, 180)
    difference = np.abs(read.frames[30].astype(int) - sequences[0].frames[30])
    assert difference.mean() < 4


def test_writing_goes_on_where_it_stopped_and_says_what_went_wrong(tmp_path):
    sequences = [synthesise(configure(seed=seed, **SMALL, length=3)) for seed in (1, 2)]

    def broken():
        yield sequences[0]
        raise OSError("disk full")

    with pytest.raises(EntrackError, match="1 sequences are there: disk full"):
        write(broken(), tmp_path)
    assert (tmp_path / "list.txt").read_text().split() == [sequences[0].name]
    stamp = (tmp_path / sequences[0].name / "00000001.jpg").stat().st_mtime_ns
    write(sequences, tmp_path)
    assert (tmp_path / sequences[0].name / "00000001.jpg").stat().st_mtime_ns == stamp
    assert len((tmp_path / "list.txt").read_text().split()) == 2
    assert not list(tmp_path.glob("*.part"))
    longer = synthesise(configure(seed=1, **SMALL, length=4))
    with pytest.raises(EntrackError, match="holds another sequence of that name"):
        write([longer], tmp_path)


@pytest.mark.parametrize(
    ("values", "sentence"),
    [
        ({"scale": 0.5}, "scale: .*greater than or equal to 1, found 0.5"),
        ({"length": 0}, "length: .*found 0"),
        ({"lookalikes": "many"}, "lookalikes: .*integer.*found 'many'"),
        ({"wobble": 1}, "no field 'wobble'"),
        ({"width": 10}, "width: .*found 10"),
    ],
)
def test_bad_configurations_are_refused_with_one_sentence(values, sentence):
    with pytest.raises(EntrackError, match=sentence) as caught:
        configure(**values)
    assert "\n" not in str(caught.value)


def test_what_does_not_fit_is_refused_with_a_sentence_that_helps():
    with pytest.raises(EntrackError, match="need 66 frames or more, found 50"):
        synthesise(configure(**SMALL, full_occlusion=30, length=50))
    huge = configure(width=96, height=64, target_size=60, full_occlusion=10, length=50)
    with pytest.raises(EntrackError, match="found no way to show FOC in 50 frames of 96 × 64"):
        synthesise(huge)
    with pytest.raises(EntrackError, match="no attribute 'fog'"):
        sample(0, ["fog"])


@pytest.mark.parametrize(
    ("pictures", "sentence"),
    [
        (np.zeros((8, 8, 3), np.uint8), r"found \(1, 8, 8, 3\) uint8"),
        (np.zeros((8, 8, 4)), "float64"),
        (np.zeros((2, 8, 8, 4), np.uint8), "found an empty one"),
    ],
)
def test_bad_sprites_are_refused(pictures, sentence):
    with pytest.raises(EntrackError, match=sentence):
        sprite(pictures)


def test_a_mirrored_sprite_is_the_mirrored_picture():
    thing = sprite(texture.cutout(np.random.default_rng(0), 64))
    mirrored = thing.mirrored
    np.testing.assert_array_equal(mirrored.shapes[0][0], thing.shapes[0][0][:, ::-1])
    assert mirrored.hulls[0][:, 0].max() == pytest.approx(-thing.hulls[0][:, 0].min())


def test_splines_stay_between_their_control_points_and_strolls_in_their_rectangle():
    rng = np.random.default_rng(0)
    control = rng.uniform(-1, 1, (9, 2))
    track = motion.spline(control, 500)
    assert (track.min(axis=0) >= control.min(axis=0)).all()
    assert (track.max(axis=0) <= control.max(axis=0)).all()
    assert np.abs(np.diff(track, 3, axis=0)).max() < 1e-3
    path = motion.stroll(rng, (10, 20), (110, 80), np.full(300, 4.0))
    assert (path >= (10, 20)).all()
    assert (path <= (110, 80)).all()
    assert np.hypot(*np.diff(path, axis=0).T).mean() == pytest.approx(4, rel=0.03)


def test_noise_has_the_spectrum_of_photographs():
    field = texture.noise(np.random.default_rng(0), 128, 128, slope=1.0)
    power = np.abs(np.fft.rfft2(field)) ** 2
    fy, fx = np.fft.fftfreq(128)[:, None], np.fft.rfftfreq(128)[None]
    frequency = np.hypot(fy, fx)
    bands = [(power[(frequency > f) & (frequency < 1.3 * f)].mean()) for f in (0.03, 0.12)]
    assert np.log2(bands[0] / bands[1]) / 2 == pytest.approx(2, abs=0.2)  # power falls as 1/f²
