"""The `noctule` command: its subcommands, and how everything that goes wrong becomes one line."""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Callable, Sequence

from cyclopts import App, CycloptsError

from noctule import __version__
from noctule.cli.calibrate_camera import calibrate_camera
from noctule.cli.commands import doctor, fly, missions, report
from noctule.cli.complaints import complaint
from noctule.cli.experiment_command import experiment
from noctule.cli.identifying import identify
from noctule.cli.locate_commands import (
    calibrate_background,
    calibrate_detector,
    calibrate_offset,
    calibrate_record,
    calibrate_sensors,
    calibrate_template,
    locate,
)
from noctule.cli.nodes import node_depth, node_fusion, node_markers, node_onboard
from noctule.cli.path_commands import path_check, path_show, teach
from noctule.errors import NoctuleError

REACHED, FAILED, BAD_INPUT, INTERRUPTED = 0, 1, 2, 130

_EXAMPLES: dict[Callable[..., int], str] = {
    fly: "noctule fly two-columns --seed 3 --out flights/try",
    missions: "noctule missions --out my-missions",
    experiment: "noctule experiment servo-5.1 --law published --seeds 0:10 --json",
    report: "noctule report flights/try --out flights/try/report",
    doctor: "noctule doctor --json",
    teach: "noctule teach --video walk.mp4 --focal 510 --out paths/walk",
    locate: "noctule locate --simulated --person --site sites/lab",
    identify: "noctule identify axes.mcap --validation validation.mcap --out sites/lab",
}
_PATH_EXAMPLES: dict[str, tuple[Callable[..., int], str]] = {
    "show": (path_show, "noctule path show paths/walk"),
    "check": (path_check, "noctule path check paths/walk --mission two-columns"),
}

_CALIBRATE_EXAMPLES: dict[str, tuple[Callable[..., int], str]] = {
    "camera": (calibrate_camera, "noctule calibrate camera pictures/ --extrinsics floor.png --out sites/lab"),
    "background": (calibrate_background, "noctule calibrate background --simulated --out sites/lab"),
    "detector": (calibrate_detector, "noctule calibrate detector --simulated --site sites/lab"),
    "template": (calibrate_template, "noctule calibrate template --simulated --site sites/lab"),
    "offset": (
        calibrate_offset,
        "noctule calibrate offset --simulated --site sites/lab --height 1.2 --at 0,0",
    ),
    "sensors": (calibrate_sensors, "noctule calibrate sensors flights/try/sensors.mcap --site sites/lab"),
    "record": (calibrate_record, "noctule calibrate record --simulated --flight path --out path.mcap"),
}
_NODE_EXAMPLES: dict[str, tuple[Callable[..., int], str]] = {
    "onboard": (node_onboard, "noctule node onboard --recording flights/try/flight.mcap"),
    "depth": (node_depth, "noctule node depth --site sites/lab --device NAME"),
    "markers": (node_markers, "noctule node markers --site sites/lab --device NAME"),
    "fusion": (node_fusion, "noctule node fusion --out flights/fused"),
}


def build() -> App:
    """Return the command-line application."""
    app = App(
        name="noctule",
        help="Indoor flight for low-cost quadcopters, without motion capture.",
        help_epilogue="Try it: noctule fly",
        version=__version__,
        help_format="plaintext",
        suppress_keyboard_interrupt=False,
    )
    for command, example in _EXAMPLES.items():
        app.command(command, help_epilogue=f"Example: {example}")
    _add_group(app, "path", "Look at a taught path, and judge whether it can be repeated.", _PATH_EXAMPLES)
    _add_group(
        app,
        "calibrate",
        "Teach a depth camera of the room what it needs to locate the drone.",
        _CALIBRATE_EXAMPLES,
    )
    _add_group(app, "node", "Sensors that agree without a centre: one process for each.", _NODE_EXAMPLES)
    return app


def _add_group(app: App, name: str, text: str, commands: dict[str, tuple[Callable[..., int], str]]) -> None:
    group = App(name=name, help=text)
    for command_name, (command, example) in commands.items():
        group.command(command, name=command_name, help_epilogue=f"Example: {example}")
    app.command(group)


def run(tokens: Sequence[str]) -> int:
    """Run one command and return the exit code.

    0: all went well (a flight reached its end); 1: a flight did not, or the machine failed it; 2: bad input;
    130: Ctrl-C. A mistake of the person's, or of the machine's, is one line on stderr and never a traceback.
    """
    try:
        answer = build()(
            list(tokens), exit_on_error=False, print_error=False, result_action="return_value", verbose=False
        )
    except CycloptsError as error:
        return _fail(tokens, complaint(error), BAD_INPUT)
    except NoctuleError as error:
        return _fail(tokens, str(error), BAD_INPUT)
    except BrokenPipeError:  # the reader of our output left, as `| head` does
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return FAILED
    except OSError as error:
        return _fail(tokens, f"{error.filename or 'the system'}: {error.strerror or error}", FAILED)
    except KeyboardInterrupt:
        return _fail(tokens, "stopped by Ctrl-C", INTERRUPTED)
    return answer if isinstance(answer, int) else REACHED


def _fail(tokens: Sequence[str], message: str, code: int) -> int:
    print(f"noctule: {message}", file=sys.stderr)
    if "--json" in tokens:
        print(json.dumps({"error": message}))
    return code
