"""What `export` does."""

from pathlib import Path

from ..exports.file_export import export_file
from ..terminal import bars, console


def run_export(file: Path, out: Path, options: dict, *, as_json: bool) -> None:
    """Export and report."""
    with bars.progress_bar(f"exporting {file}", quiet=as_json) as watch:
        values = export_file(file, out, watch=watch, **options)
    console.show_values(values, as_json=as_json, title=str(out))
