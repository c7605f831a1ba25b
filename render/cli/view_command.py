"""What `palpate view` does: a page that is served until Ctrl-C, or one that is written."""

from pathlib import Path
from typing import Any

from ...datasets.sweeps.check import is_sweep_data
from ..errors import StrategyError
from ..playback.placed_arrays import load_rig
from ..runtime.warp_start import start_warp
from ..terminal import bars, console
from ..terminal.foreign_text import print_message, write_output
from ..validation import refuse_object
from ..view.live.session import open_browser, view_files
from ..view.page.export import LIMIT, export_page

OF_A_PAGE = ("poses", "every", "limit", "overwrite")
OF_A_SERVER = ("port", "no_browser", "allow_code")


def run_view(files: list[Path], options: dict[str, Any], *, as_json: bool) -> None:
    """Serve until Ctrl-C, or export."""
    for file in files:
        if not is_sweep_data(file):
            refuse_object(file)
    if options["export"] is not None:
        _refuse_given(options, OF_A_SERVER, "of a page that is served; --export writes one")
        _export(files, options, as_json=as_json)
        return
    _refuse_given(options, OF_A_PAGE, "of a page that --export writes")
    start_warp()

    def tell(address: str) -> None:
        if as_json:
            write_output(console.json_line({"address": address}))
        else:
            print_message(f"palpate shows {' and '.join(map(str, files))} on {address} until Ctrl-C")
        if not options["no_browser"] and not open_browser(address):
            print_message(f"no browser could be opened here: open {address} in one on this machine")

    try:
        view_files(
            files,
            port=options["port"],
            array=options["array"],
            calibration=options["calibration"],
            allow_code=options["allow_code"],
            ready=tell,
        )
    except KeyboardInterrupt:
        return


def _export(files: list[Path], options: dict[str, Any], *, as_json: bool) -> None:
    """Write one page of all files, and say how large it is."""
    for file in files:
        if file.is_dir() and is_sweep_data(file):
            raise StrategyError(f"{file} is a sweep's store: --export takes contour files")
    start_warp()
    with bars.loading_bar(f"writing {options['export']}", quiet=as_json):
        facts = export_page(
            files,
            options["export"],
            poses=options["poses"],
            every=options["every"],
            limit=LIMIT if options["limit"] is None else options["limit"],
            overwrite=options["overwrite"],
            array=load_rig(options["array"], calibration=options["calibration"]),
        )
    console.show_values(facts, as_json=as_json, title="page")


def _refuse_given(options: dict[str, Any], names: tuple[str, ...], belonging: str) -> None:
    for name in names:
        if options[name] is not None and options[name] is not False:  # 0 is given
            raise StrategyError(f"--{name.replace('_', '-')} is {belonging}")
