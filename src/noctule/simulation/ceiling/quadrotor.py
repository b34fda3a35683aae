"""A quadrotor shaped like an AR.Drone 2.0, as parts in body axes (FLU), its origin the hull's centre.

Outer measures are the maker's: 0.45 x 0.29 m without the indoor hull (the rotors apart, whose tips reach
0.45 m both ways), 0.52 x 0.52 m with it. Front and back differ as they do there: a blunt nose with the
camera, a slender tail, the canopy a little ahead of the middle.
"""

from __future__ import annotations

from noctule.simulation.ceiling.shapes import Part, Shape, along

MOTOR = 0.126  # [m], of a motor's axis from the middle, ahead and aside
ROTOR = 0.100  # [m], radius
RING = 0.130  # [m], radius of a foam ring; its centre is as far from the middle, ahead and aside
MARKER = 0.035  # [m], radius
MARKER_X = 0.095  # [m], ahead and behind
TOP = 0.038  # [m], the highest point above the origin

_FOAM, _PLASTIC, _CARBON = 0.35, 0.18, 0.15  # reflectances of infrared
_BLACK, _GREY, _WHITE = (0.13, 0.13, 0.14), (0.3, 0.3, 0.31), (0.75, 0.75, 0.72)
_SIDES = ((1.0, 1.0), (1.0, -1.0), (-1.0, -1.0), (-1.0, 1.0))


def quadrotor(hull: bool, markers: bool) -> tuple[Part, ...]:
    """Return the parts of a quadrotor, bare (with its outdoor hull) or with the indoor hull."""
    parts = [*_body(hull), *(part for side in _SIDES for part in _corner(*side, hull))]
    if markers:
        for x, rgb in ((MARKER_X, (0.9, 0.06, 0.06)), (-MARKER_X, (0.06, 0.12, 0.9))):
            parts.append(Part(Shape.TUBE, (x, 0.0, TOP - 0.002), (MARKER, MARKER, 0.002), rgb=rgb))
    return tuple(parts)


def _body(hull: bool) -> list[Part]:
    nose, tail, wide = (0.19, -0.17, 0.06) if hull else (0.225, -0.225, 0.056)
    rgb = _GREY if hull else _BLACK
    return [
        _egg((0.01, 0.0, 0.004), (0.115, wide, TOP - 0.008), rgb),  # canopy over battery and boards
        _egg((nose - 0.085, 0.0, -0.002), (0.085, 0.046, 0.03), rgb),
        _egg((tail + 0.1, 0.0, -0.004), (0.1, 0.034, 0.024), rgb),
        Part(Shape.BOX, (nose - 0.03, 0.0, -0.004), (0.022, 0.026, 0.018), reflectance=_PLASTIC, rgb=_BLACK),
        Part(Shape.BOX, (-0.02, 0.0, -0.022), (0.08, 0.04, 0.014), reflectance=_PLASTIC, rgb=_BLACK),
    ]


def _egg(
    centre: tuple[float, float, float], half: tuple[float, float, float], rgb: tuple[float, float, float]
) -> Part:
    return Part(Shape.ELLIPSOID, centre, half, reflectance=_FOAM, rgb=rgb)


def _corner(ahead: float, aside: float, hull: bool) -> list[Part]:
    x, y = ahead * MOTOR, aside * MOTOR
    middle, rotation, half = along((0.02 * ahead, 0.02 * aside, -0.008), (x, y, -0.004))
    parts = [
        Part(Shape.TUBE, middle, (0.007, 0.007, half), rotation, reflectance=_CARBON, rgb=_BLACK),
        Part(Shape.TUBE, (x, y, -0.002), (0.019, 0.019, 0.022), reflectance=_PLASTIC, rgb=_BLACK),  # gears
        Part(Shape.BOX, (x, y, -0.035), (0.008, 0.008, 0.025), reflectance=_PLASTIC, rgb=_BLACK),  # foot
        # What a spinning rotor sends back: here and there something, most rays pass.
        Part(
            Shape.TUBE,
            (x, y, 0.017),
            (ROTOR, ROTOR, 0.004),
            inner=0.014,
            opacity=0.2,
            reflectance=0.3,
            rgb=_GREY,
        ),
    ]
    if hull:
        centre = (ahead * RING, aside * RING, 0.0)
        parts.append(
            Part(Shape.TUBE, centre, (RING, RING, 0.024), inner=RING - 0.02, reflectance=_FOAM, rgb=_GREY)
        )
        # The web between body and ring.
        start, end = (0.03 * ahead, 0.03 * aside, 0.0), (0.062 * ahead, 0.062 * aside, 0.0)
        at, turned, long = along(start, end)
        parts.append(
            Part(Shape.ELLIPSOID, at, (0.022, 0.03, 1.6 * long), turned, reflectance=_FOAM, rgb=_GREY)
        )
    return parts
