"""Cells of a CSV as spreadsheets write them: between commas, semicolons or tabs, with decimal points or commas."""

COMMA = ","


def separator_of(header: str) -> str:
    """The separator of a CSV by its header's line: comma, semicolon or tab, whichever is there most often.

    Of as many the comma, after which some writers set a tab.
    """
    return max(f"{COMMA};\t", key=header.count)


def wrong_count(found: int, wanted: int, separator: str) -> str:
    """The sentence on a row that has not as many cells as the header; decimal commas make more."""
    decimal = separator == COMMA and wanted < found <= 2 * wanted
    return f"{found} columns, the header has {wanted}" + ("; decimal commas need semicolons between cells" * decimal)


def number_in(cell: str, separator: str) -> float:
    """The number in a cell; where commas do not separate cells, one is a decimal comma.

    Raises ValueError for anything else, Python's own digit separator `_` included, which no file means.
    """
    if "_" in cell:
        raise ValueError(cell)
    return float(cell if separator == COMMA else cell.replace(COMMA, "."))
