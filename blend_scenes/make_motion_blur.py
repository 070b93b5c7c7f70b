"""Motion blur: what spins, what flies and what bends while the shutter is open for half a frame."""

from __future__ import annotations

import math

import bpy

from blend_scenes import building

FRAME = 10
# Metres in a frame, colors and places of balls.
BALLS = (
    (0.0, (0.2, 0.2, 0.22), (-0.7, -1.9, 0.4)),
    (0.5, (0.1, 0.45, 0.2), (0.6, -1.3, 0.4)),
    (1.6, (0.7, 0.12, 0.06), (0.3, 0.8, 1.5)),
)
BLADES = 5
BLADE = ((0.1, -0.05), (0.95, -0.3), (1.05, 0.0), (0.95, 0.3), (0.1, 0.05))


def build() -> None:
    """Fill the scene: a wind wheel that turns, balls that fly at three speeds, a post that sways, a ball at rest."""
    scene = building.start_scene(width=640, height=400)
    building.set_world((0.6, 0.75, 1.0), 0.5)
    tiles = [
        building.make_shader("Light tile", "Diffuse", (0.7, 0.68, 0.62)),
        building.make_shader("Dark tile", "Diffuse", (0.22, 0.2, 0.18)),
    ]
    building.link_object("Floor", building.make_chequers("Floor", 16, 24), materials=tiles)
    add_wheel()
    for number, (speed, color, place) in enumerate(BALLS):
        paint = building.make_principled(f"Paint {number}", color, roughness=0.25)
        ball = building.link_object(f"Ball {number}", building.make_sphere("Ball", 0.4, 48), place, materials=[paint])
        if speed:
            move(ball, speed)
    add_post()
    sun = building.add_light("Sun", "SUN", 3.5, (-3.0, -4.0, 6.0), (0.0, 0.0, 0.0))
    sun.data.angle = math.radians(2.0)
    building.add_camera((0.0, -8.5, 2.6), (0.0, 0.0, 1.1), 45)
    scene.render.use_motion_blur, scene.render.motion_blur_shutter = True, 0.5
    scene.frame_set(FRAME)


def move(ball: bpy.types.Object, speed: float) -> None:
    """Let a ball fly along x, metres a frame, past where it stands."""
    middle = ball.location.x
    for frame in (FRAME - 1, FRAME + 1):
        ball.location.x = middle + speed * (frame - FRAME)
        ball.keyframe_insert("location", frame=frame)


def add_wheel() -> None:
    """Add a wind wheel on a pole; it turns by 50 degrees in a frame, followed in nine steps."""
    white = building.make_principled("White paint", (0.8, 0.8, 0.78), roughness=0.4)
    red = building.make_principled("Red paint", (0.75, 0.08, 0.05), roughness=0.4)
    pole = building.make_lathe("Pole", ((0.0, 0.0), (0.07, 0.0), (0.04, 2.0), (0.0, 2.0)), 24)
    building.link_object("Pole", pole, (-2.2, 0.35, 0.0), materials=[white])
    vertices, faces = [(0.0, 0.0, 0.0)], []
    for blade in range(BLADES):
        turn = math.tau * blade / BLADES
        first = len(vertices)
        for x, y in BLADE:
            vertices.append((x * math.cos(turn) - y * math.sin(turn), 0.0, x * math.sin(turn) + y * math.cos(turn)))
        faces.append((0, *range(first, first + len(BLADE))))
    wheel = building.new_mesh("Wheel", vertices, faces)
    spinning = building.link_object("Wheel", wheel, (-2.2, 0.2, 2.0), materials=[red])
    for frame in (FRAME - 1, FRAME + 1):
        spinning.rotation_euler.y = math.radians(50.0) * (frame - FRAME)
        spinning.keyframe_insert("rotation_euler", frame=frame)
    if hasattr(spinning, "cycles"):
        spinning.cycles.motion_steps = 3


def add_post() -> None:
    """Add a post of rubber whose top sways: a shape key bends it."""
    rubber = building.make_principled("Rubber", (0.1, 0.25, 0.6), roughness=0.5)
    profile = ((0.0, 0.0), (0.3, 0.0), *((0.22 - 0.01 * step, 0.15 * step + 0.05) for step in range(16)), (0.0, 2.3))
    post = building.link_object("Post", building.make_lathe("Post", profile, 32), (2.3, 0.2, 0.0), materials=[rubber])
    post.shape_key_add(name="Basis")
    bent = post.shape_key_add(name="Bent")
    for point in bent.data:
        point.co.x += 0.16 * point.co.z**2
    bent.slider_min = -1.0
    for frame, value in ((FRAME - 1, -0.8), (FRAME + 1, 1.0)):
        bent.value = value
        bent.keyframe_insert("value", frame=frame)


if __name__ == "__main__":
    build()
    building.save_scene(building.SCENES / "motion_blur.blend")
