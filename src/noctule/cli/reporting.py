"""`noctule report`: of one recording, or of campaigns side by side."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from noctule.cli.flights import RESULTS
from noctule.cli.show import as_json
from noctule.errors import NoctuleError


class ReportInputError(NoctuleError):
    """Nothing, or something else than recordings, to report on."""


def report_on(recordings: Sequence[Path], seed: int | None, out: Path | None, as_json_line: bool) -> int:
    """Write the report and print where its page is; 0 when it was written."""
    if not recordings:
        raise ReportInputError("no recording given, expected a .mcap file or the folder of a flight")
    campaigns = [path for path in recordings if (path / RESULTS).is_file()]
    if campaigns and seed is None:
        page = _side_by_side(recordings, out)
    elif len(recordings) > 1:
        raise ReportInputError(
            f"{len(recordings)} recordings given, expected one; several are laid side by side only when each "
            "is the folder of a campaign flown with --seeds"
        )
    else:
        from noctule.reports import write_report

        page = write_report(_recording(recordings[0], seed), out)
    print(as_json({"report": page}) if as_json_line else f"report: {page}")
    return 0


def _recording(path: Path, seed: int | None) -> Path:
    if not path.is_dir():
        return path
    folder = path if seed is None else path / f"seed-{seed}"
    found = sorted(folder.glob("*.mcap"))
    if len(found) != 1:
        raise ReportInputError(
            f"folder {folder}: holds {len(found)} recordings, expected one; name the .mcap file"
        )
    return found[0]


def _side_by_side(folders: Sequence[Path], out: Path | None) -> Path:
    from noctule.reports import write_campaign_report

    laws: dict[str, Any] = {}
    for folder in folders:
        try:
            results = json.loads((folder / RESULTS).read_text(encoding="utf-8"))
        except (OSError, ValueError) as error:
            raise ReportInputError(
                f"folder {folder}: {RESULTS} cannot be read ({error}), expected the folder of a campaign"
            ) from None
        for law, part in results.items():
            if law in laws:
                raise ReportInputError(f"folder {folder}: law {law!r} is given twice, expected each law once")
            laws[law] = part
    return write_campaign_report(laws, out if out is not None else folders[0] / "report")
