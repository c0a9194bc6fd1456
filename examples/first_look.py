"""Draw a frame of the mirror camera and its panorama, with the landmarks' names at their bearings.

Needs a server whose robot has an omnidirectional camera:

    catoptra-server --robot examples/first_look.ini --world configs/worlds/four_legged_2006.ini
    python examples/first_look.py first-look.png

docs/first-look.png is drawn by these two lines. A file that ends in .webp shows a drive along an
ellipse; the server of docs/laboratory.webp has `--robot p2at_omni_live --world laboratory --clock
lockstep`.
"""

from __future__ import annotations

import argparse
import math
from pathlib import Path

import cv2
import numpy as np

from catoptra_client.frame import Frame, Pixels
from catoptra_client.frame_pictures import choose_cylinder, make_panorama, write_image
from catoptra_client.frame_sources import ImageEncoding, StreamClient
from catoptra_protocol.optics.numerics import Floats
from catoptra_protocol.optics.omni_camera import OmniCamera, direction_from_pixel

START_M, YAW_RAD = (-0.6, 0.4, 0.0), 0.5  # off the lines of the field, which look straight there
WIDTH_PX, MARGIN_PX, PANORAMA_PX, FONT_PX = 1000, 40, 210, 16
NUM_PICTURES, SMALL_PX = 18, (620, 470)
BACKGROUND, INK = (255, 255, 255), (40, 40, 40)


def main() -> None:
    """Spawn a robot, request its frame, and write the picture."""
    parser = argparse.ArgumentParser(description="Draw a frame with the names of its landmarks.")
    parser.add_argument("output", type=Path, help="PNG or JPEG file, or WebP of a drive")
    parser.add_argument("--port", type=int, default=5005, help="of the stream (default 5005)")
    parsed = parser.parse_args()
    with StreamClient.connect("127.0.0.1", parsed.port) as robot:
        if parsed.output.suffix == ".webp":
            draw_drive(robot, parsed.output)
            return
        frame, camera, pixels = look(robot, START_M, YAW_RAD)
    print(frame)
    bearings = {name: find_bearing(camera, pixel) for name, pixel in pixels.items()}
    rows = (draw_frame(frame.rgb, camera, pixels), draw_panorama(frame, camera, bearings))
    write_image(parsed.output, np.concatenate(rows))


def look(
    robot: StreamClient, location_m: tuple[float, float, float], yaw_rad: float
) -> tuple[Frame, OmniCamera, dict[str, tuple[float, float]]]:
    """Frame of a new robot, its camera, and the pixels of the landmarks that it sees."""
    robot.spawn("USARBot.OmniP2AT", location_m=location_m, rotation_rad=(0.0, 0.0, yaw_rad))
    frame = robot.get_frame(encoding=ImageEncoding.PNG)
    camera = frame.camera
    assert isinstance(camera, OmniCamera), "the robot's camera, as the server describes it"
    pixels = {
        landmark.landmark.name.replace("_", " "): landmark.pixel
        for landmark in robot.get_landmark_projections()
        if landmark.pixel is not None and landmark.visible
    }
    return frame, camera, pixels


def draw_drive(robot: StreamClient, path: Path) -> None:
    """An endless drive around the middle of the field."""
    animation = cv2.Animation()
    pages = []
    for angle in np.linspace(0.0, 2.0 * math.pi, NUM_PICTURES, endpoint=False).tolist():
        place = (1.3 * math.cos(angle), 0.75 * math.sin(angle), 0.0)
        yaw_rad = math.atan2(0.75 * math.cos(angle), -1.3 * math.sin(angle))
        frame, camera, pixels = look(robot, place, yaw_rad)
        robot.reset()
        page = draw_frame(frame.rgb, camera, pixels)
        pages.append(
            cv2.cvtColor(cv2.resize(page, SMALL_PX, None, 0, 0, cv2.INTER_AREA), cv2.COLOR_RGB2BGR)
        )
    animation.frames, animation.durations = pages, np.full(NUM_PICTURES, 160, np.int32)
    cv2.imwriteanimation(str(path), animation, [cv2.IMWRITE_WEBP_QUALITY, 30])


def find_bearing(camera: OmniCamera, pixel: tuple[float, float]) -> float:
    """Bearing of a pixel in radians, positive to the right."""
    (x, y, _), _ = direction_from_pixel(camera, np.array(pixel))
    return math.atan2(y, x)


def draw_frame(rgb: Pixels, camera: OmniCamera, pixels: dict[str, tuple[float, float]]) -> Pixels:
    """The frame on a wide page; a line leads from each landmark to its name outside the mirror."""
    size = rgb.shape[0]
    # 1000 px for the 640 of the first look, as wide as its panorama.
    left = 180
    page = np.full((size + 2 * MARGIN_PX, size + 2 * left, 3), BACKGROUND, np.uint8)
    weight = compute_mirror_coverage(camera)[..., None]
    page[MARGIN_PX:-MARGIN_PX, left : left + size] = np.uint8(
        weight * rgb + (1.0 - weight) * np.array(BACKGROUND)
    )
    corner = np.array([left, MARGIN_PX])
    centre = corner + camera.centre_px
    for name, pixel in pixels.items():
        landmark = corner + pixel
        outward = (landmark - centre) / np.linalg.norm(landmark - centre)
        end = centre + (0.5 * size + 10) * outward
        draw_line(page, landmark + 14 * outward, end - 10 * outward)
        write_text(page, name, end, anchor=0.0 if outward[0] > 0 else 1.0)
    return page


def compute_mirror_coverage(camera: OmniCamera) -> Floats:
    """Fraction of each pixel (h, w) that lies within the mirror's rim."""
    rows, columns = np.indices((camera.height_px, camera.width_px))
    u, v = camera.centre_px
    radius = np.hypot(columns + 0.5 - u, rows + 0.5 - v)
    # A pixel inside the rim, where the frame itself is already mixed with black.
    coverage: Floats = np.clip(camera.rim_radius_px - 0.5 - radius, 0.0, 1.0)
    return coverage


def draw_panorama(frame: Frame, camera: OmniCamera, bearings: dict[str, float]) -> Pixels:
    """The upper rows of the panorama, below the names at their columns."""
    panorama = make_panorama(frame, WIDTH_PX)[:PANORAMA_PX]
    page = np.concatenate((np.full((2 * MARGIN_PX, WIDTH_PX, 3), BACKGROUND, np.uint8), panorama))
    cylinder = choose_cylinder(camera, WIDTH_PX)
    horizon = 2 * MARGIN_PX + cylinder.row_from_slope(0.0)
    for number, (name, bearing) in enumerate(sorted(bearings.items(), key=lambda item: item[1])):
        column = float(cylinder.column_from_azimuth(bearing))
        height = 52 - 26 * (number % 2)  # neighbours in two rows
        draw_line(page, np.array([column, height + 8]), np.array([column, horizon - 12]))
        text = f"{name} {math.degrees(bearing):+.0f}°"
        write_text(page, text, np.array([column, height]), anchor=0.5)
    return page


def draw_line(page: Pixels, start: Floats, end: Floats) -> None:
    """Draw a thin line with a dark border, visible on any colour."""
    (u0, v0), (u1, v1) = (16.0 * np.array([start, end])).round().astype(int).tolist()
    for width, colour in ((3, INK), (1, BACKGROUND)):
        cv2.line(page, (u0, v0), (u1, v1), colour, width, cv2.LINE_AA, shift=4)


def write_text(page: Pixels, text: str, position: Floats, anchor: float) -> None:
    """Write a name beside a position, which has this fraction of its width on the left."""
    font = cv2.FontFace("sans")
    _, _, width, _ = cv2.getTextSize((WIDTH_PX, 1), text, (0, 0), font, FONT_PX, 400)
    x = min(max(float(position[0]) - anchor * width, 0.0), page.shape[1] - width)
    cv2.putText(page, text, (round(x), round(float(position[1])) + 5), INK, font, FONT_PX, 400)


if __name__ == "__main__":
    main()
