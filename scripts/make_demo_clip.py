"""Make the demo clip: a shell game with three cups of coffee on a paved floor.

    python scripts/make_demo_clip.py [OUT]

Everything is cut out of photographs that scikit-image carries (`pip install scikit-image`), see
src/entrack/assets/demo/README.md for where they come from, and rendered by
`entrack.datasets.synthetic`, so that the target's boxes are exact. Writes clip.mp4 and clip.txt
(x,y,w,h a frame, 0-based; nan where the target is hidden).
"""

import sys
from fractions import Fraction
from pathlib import Path

import av
import cv2
import numpy as np
import skimage

from entrack.datasets.frames import Image
from entrack.datasets.synthetic import Actor, Scene, Sprite, motion, sprite, texture

PHOTOS = Path(skimage.__file__).parent / "data"
OUT = Path(__file__).parents[1] / "src/entrack/assets/demo"
WIDTH, HEIGHT, FPS, LENGTH = 640, 360, 30, 390
DETAIL = 1.5  # pixels of the world for one of the picture
WORLD = int(1000 * DETAIL), int(660 * DETAIL)
HORIZON = 480  # pixels of the picture from the middle up to where things shrink to nothing
CUP_SIZE, SPACING = 92, 130
COURSE = int(44 * DETAIL)  # pixels of brick and joint
# From frame, to frame, which neighbours swap places (0 the left two), which way around.
SWAPS = (15, 72, 0, 1), (72, 130, 1, -1), (136, 196, 0, 1), (200, 258, 1, 1), (262, 322, 0, -1)
SLATE = (34, 118, 240), (24, 92, 226), (18, 70, 214)  # BGR of what is dark, of bricks, of joints

# Around cup, saucer and spoon in coffee.png at twice its size.
CUP = """
358,143 300,172 237,224 192,284 166,350 155,420 158,490 175,560 206,617 250,666 310,709 380,743
460,766 550,776 640,772 720,755 790,725 850,680 902,622 938,550 955,480 957,420 945,362 922,308
888,258 838,208 849,152 845,140 826,134 799,142 770,111 720,76 660,51 600,38 540,40 470,55 410,86
374,124
"""
LEAVES = (20, 200, 120), (30, -25, 125), (42, 215, 110), (50, -40, 105), (57, 268, 110)


def main(out: Path) -> None:
    out.mkdir(parents=True, exist_ok=True)
    scene = make_scene()
    boxes = np.where(scene.absent[:, None], np.nan, scene.boxes)
    np.savetxt(out / "clip.txt", boxes, "%.2f", ",")
    encode(scene, out / "clip.mp4")
    size = (out / "clip.mp4").stat().st_size
    print(
        f"{out / 'clip.mp4'}: {len(scene)} frames, {size / 1e6:.2f} MB, "
        f"at least {scene.visible.min():.0%} of the target to be seen"
    )


def make_scene() -> Scene:
    """A shell game with three cups, and a twig before the lens."""
    cup = cut_cup()
    target, green, twin = dance()
    rng = np.random.default_rng(3)
    eye = path(
        "-30,10 -30,10 -20,10 20,0 40,-20 60,-30 60,-30 40,-40 20,-50 -10,-40 -20,-10 "
        "-40,15 -65,40 -75,45 -75,45"
    )
    zoom = path("1 1 1.02 1.05 1.08 1.05 1 1 1.02 1.06 1.1 1.2 1.35 1.42 1.42")
    roll = 0.012 * motion.wander(rng, LENGTH, 90)
    eye += motion.shake(rng, LENGTH, 0.6)
    camera = np.column_stack([DETAIL * eye, zoom / DETAIL, roll])
    light = np.tile([1.0, 0.0, 0.0, 0.0], (LENGTH, 1))
    light[:, 0] += 0.06 * motion.wander(rng, LENGTH, 60)
    actors = (
        on_floor(cup, target),
        on_floor(recoloured(cup), green),
        on_floor(cup[:, ::-1], twin),
        before_lens(twig(rng), eye, zoom),
    )
    return Scene(WIDTH, HEIGHT, floor(), camera, actors, 0, light, 0.4, 1.0, 1.2, 1)


def dance() -> np.ndarray:
    """Where the three cups are (3, T, 2): neighbours swap places, half a turn around each other."""
    middle = path(
        "-10,30 -10,30 -10,30 0,20 10,0 20,-25 20,-40 10,-60 0,-70 -10,-50 -10,-10 0,30 "
        "0,50 0,50 0,50"
    )
    offsets = np.zeros((3, LENGTH, 2))
    offsets[..., 0] = np.array([[-SPACING], [0], [SPACING]])
    order = [0, 1, 2]  # who is left, in the middle, right
    for start, end, left, side in SWAPS:
        one, other = order[left], order[left + 1]
        turn = np.pi * motion.ease(LENGTH, end, LENGTH, end - start)
        shift = SPACING * (1 - np.cos(turn)) / 2
        depth = side * 0.36 * SPACING * np.sin(turn)
        offsets[one] += np.stack([shift, depth], axis=1)
        offsets[other] -= np.stack([shift, depth], axis=1)
        order[left], order[left + 1] = other, one
    return middle + offsets * (1 + middle[:, 1:] / HORIZON)


def path(points: str) -> motion.Track:
    """A smooth track by points that are a second or so apart."""
    track = motion.spline([tuple(map(float, p.split(","))) for p in points.split()], LENGTH)
    return track if track.shape[1] > 1 else track[:, 0]


def on_floor(cup: Image, place: motion.Track) -> Actor:
    """Stand a cup on the floor: the nearer, the larger."""
    thing = sprite(cup, shadow=0.55, towards=(-0.04, 0.035))
    scale = DETAIL * CUP_SIZE / thing.size * (1 + place[:, 1] / HORIZON)
    return still_life(thing, DETAIL * place, scale, place[:, 1])


def before_lens(picture: Image, eye: motion.Track, zoom: motion.Track) -> Actor:
    """Let a twig lean into the picture and out again."""
    lean = motion.ease(LENGTH, 164, 178, 40)
    breeze = np.sin(np.arange(LENGTH) / 11)
    seen = np.array([585, 400]) + np.outer(lean, (-170, -165)) + np.outer(breeze, (4, 2))
    place = DETAIL * (eye + (seen - (WIDTH / 2, HEIGHT / 2)) / zoom[:, None])
    turn = 0.12 - 0.25 * lean + 0.02 * breeze
    thing = sprite(picture, shadow=0)
    return still_life(thing, place, DETAIL / zoom, np.full(LENGTH, np.inf), turn)


def still_life(
    thing: Sprite,
    place: motion.Track,
    scale: motion.Track,
    layer: motion.Track,
    turn: motion.Track | None = None,
) -> Actor:
    """A thing that has no motion of its own."""
    poses = np.column_stack([place, scale, np.ones((LENGTH, 2))])
    poses[:, 4] = 0 if turn is None else turn
    return Actor(thing, poses, np.zeros(LENGTH, np.int64), layer)


def twig(rng: np.random.Generator) -> Image:
    """Leaves, so near that they are out of focus."""
    canvas = np.zeros((400, 400, 4), np.float32)
    stem = np.array([[200, 400], [205, 300], [190, 200], [200, 110]], np.float64)
    curve = motion.spline(np.vstack([stem[:1], stem, stem[-1:]]), 60)
    cv2.polylines(canvas, [curve.astype(np.int32)], False, (38, 66, 52, 255), 5, cv2.LINE_AA)
    for along, angle, length in LEAVES:
        turned, light = np.radians(angle + rng.normal(0, 6)), rng.uniform(0.85, 1.15)
        leaf(canvas, curve[along], turned, length, light)
    canvas[..., :3] *= 1 + 0.16 * texture.noise(rng, 400, 400, 1.6)[..., None]
    canvas = cv2.GaussianBlur(canvas, (0, 0), 3.5)
    alpha = np.maximum(canvas[..., 3:], 1) / 255
    return np.dstack([np.clip(canvas[..., :3] / alpha, 0, 255), canvas[..., 3]]).astype(np.uint8)


def leaf(canvas: np.ndarray, foot: np.ndarray, angle: float, length: float, light: float) -> None:
    """Draw two halves and a vein."""
    along = np.linspace(0, 1, 40)
    width = 0.24 * length * np.sin(np.pi * along**0.8)
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    for side, colour in ((1, (48, 128, 84)), (-1, (36, 104, 64))):
        edge = np.stack([length * along, side * width], axis=1)
        points = foot + np.vstack([edge, [[length, 0], [0, 0]]]) @ turn.T
        shade = (*(light * c for c in colour), 255)
        cv2.fillPoly(canvas, [np.round(points * 16).astype(np.int32)], shade, cv2.LINE_AA, 4)
    tip = foot + np.array([0.95 * length, 0]) @ turn.T
    cv2.line(canvas, foot.astype(int), tip.astype(int), (80, 160, 120, 255), 2, cv2.LINE_AA)


def cut_cup() -> Image:
    """Cut the cup out of coffee.png: BGRA."""
    photo = cv2.imread(str(PHOTOS / "coffee.png"))
    corners = np.array([p.split(",") for p in CUP.split()], np.float64) / 2
    smooth = motion.spline(np.vstack([corners, corners[:3]]), 2000)
    mask = np.zeros(photo.shape[:2], np.uint8)
    cv2.fillPoly(mask, [np.round(smooth * 256).astype(np.int32)], 255, cv2.LINE_AA, 8)
    mask = cv2.GaussianBlur(cv2.erode(mask, np.ones((3, 3), np.uint8)), (0, 0), 0.8)
    x, y, w, h = cv2.boundingRect(mask)
    return np.dstack([photo, mask])[y - 4 : y + h + 4, x - 4 : x + w + 4]


def recoloured(cup: Image) -> Image:
    """The same cup in green: all but the white inside, the coffee and the spoon."""
    inside = np.zeros(cup.shape[:2], np.uint8)
    for middle, axes in (((216, 98), (117, 95)), ((292, 266), (41, 48))):
        cv2.ellipse(inside, middle, axes, 0, 0, 360, 255, -1, cv2.LINE_AA)
    cv2.line(inside, (305, 215), (342, 62), 255, 22, cv2.LINE_AA)
    keep = cv2.GaussianBlur(inside, (0, 0), 1.2)[..., None] / 255
    hsv = cv2.cvtColor(cup[..., :3], cv2.COLOR_BGR2HSV).astype(np.float32)
    hsv[..., 0] = (hsv[..., 0] + 68) % 180
    hsv[..., 1:] *= 0.75, 0.72
    painted = cv2.cvtColor(hsv.astype(np.uint8), cv2.COLOR_HSV2BGR)
    mixed = cup[..., :3] * keep + painted * (1 - keep)
    return np.dstack([mixed.astype(np.uint8), cup[..., 3]])


def floor() -> Image:
    """The paving of brick.png, straightened, laid anew in slate towards a horizon, and lit."""
    brick = cv2.imread(str(PHOTOS / "brick.png"), cv2.IMREAD_GRAYSCALE)
    # Two joints, eight courses apart, tell the perspective of the photograph.
    seen = np.array([[130, 0], [367.5, 0], [425, 512], [93.5, 512]], np.float32)
    flat = np.array([[2, 0], [10, 0], [10, 16], [2, 16]], np.float32) * COURSE
    straight = cv2.getPerspectiveTransform(seen, flat)
    tile = cv2.warpPerspective(brick, straight, (12 * COURSE, 16 * COURSE)).T
    slab = np.hstack([tile, tile[:, ::-1]])
    slab = np.vstack([np.roll(slab, shift, axis=1) for shift in (0, 550, 230, 790)])
    slab = np.hstack([slab, slab])
    # Laid at a slant: what is as wide as the world's picture at y = 0 is scaled by 1 + y / HORIZON.
    w, h = WORLD
    horizon = DETAIL * HORIZON
    far, near = 1 - h / 2 / horizon, 1 + h / 2 / horizon
    deep = horizon * (1 / far - 1 / near) / 0.8
    along = slab.shape[1] / 2
    ground = np.array([[-1, 0], [1, 0], [1, deep / along], [-1, deep / along]]) * along
    ground += along, 0
    picture = np.array([[-far, 0], [far, 0], [near, h / along], [-near, h / along]]) * along
    picture += w / 2, 0
    slant = cv2.getPerspectiveTransform(ground.astype(np.float32), picture.astype(np.float32))
    laid = cv2.warpPerspective(slab, slant, WORLD, flags=cv2.INTER_AREA)
    levels = np.stack([np.interp(np.arange(256), (0, 110, 255), c) for c in SLATE], axis=1)
    y, x = np.mgrid[-1 : 1 : h * 1j, -1 : 1 : w * 1j]
    pool = 1.15 - 0.45 * ((x - 0.1) ** 2 + (y + 0.05) ** 2)
    pool += 0.09 * texture.noise(np.random.default_rng(0), h, w, 1.8)  # clouds, leaves overhead
    return np.clip(levels[laid] * pool[..., None], 0, 255).astype(np.uint8)


def encode(scene: Scene, path: Path) -> None:
    """H.264 that plays in a browser."""
    part = path.with_name(f"{path.name}.part")
    with av.open(str(part), "w", format="mp4", options={"movflags": "+faststart"}) as clip:
        stream = clip.add_stream("libx264", rate=Fraction(FPS))
        stream.width, stream.height, stream.pix_fmt = WIDTH, HEIGHT, "yuv420p"
        stream.options = {"crf": "20", "preset": "veryslow", "tune": "film"}
        for t in range(len(scene)):
            clip.mux(stream.encode(av.VideoFrame.from_ndarray(scene.render(t), format="bgr24")))
        clip.mux(stream.encode())
    part.replace(path)


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else OUT)
