"""What `export` does."""

from pathlib import Path

from ..exports.file_export import export_file
from ..runtime.warp_start import start_warp
from ..terminal import bars, console


def run_export(file: Path, out: Path, options: dict, *, as_json: bool) -> None:
    """Export and report."""
    start_warp()
    with bars.progress_bar(f"exporting {file}", quiet=as_json) as watch:
        values = export_file(file, out, watch=watch, **options)
    console.show_values(values, as_json=as_json, title=str(out))
