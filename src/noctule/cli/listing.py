"""`noctule missions`: what there is to fly."""

from __future__ import annotations

import shlex
from pathlib import Path

from noctule.cli.options import out_folder
from noctule.cli.show import as_json


def list_missions(seed: int | None, out: Path | None, json: bool) -> int:
    """Print each bundled mission with the command that flies it, and copy the files to `out` if given."""
    from noctule.flight.mission import bundled_missions, load_mission

    found = bundled_missions()
    files: dict[str, Path] = {}
    if out is not None:
        folder = out_folder(out, "missions")
        for name in found:
            files[name] = folder / f"{name}.toml"
            files[name].write_text(load_mission(name).text, encoding="utf-8")
    suffix = "" if seed is None else f" --seed {seed}"
    entries = [
        {
            "name": name,
            "description": description,
            "command": f"noctule fly {shlex.quote(str(files.get(name, name)))}{suffix}",
        }
        for name, description in found.items()
    ]
    if json:
        print(as_json({"missions": entries}))
        return 0
    for entry in entries:
        print(f"{entry['name']}\n  {entry['description']}\n  {entry['command']}")
    return 0
