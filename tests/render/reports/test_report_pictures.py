"""Pictures of reports: their bytes are the same each time, and they name no page to load."""

import re

from palpate.render.reports.report_pages import ReportPicture
from palpate.render.reports.report_pictures import drawing, picture_content


def test_pictures_are_the_same_every_time_and_name_no_page_to_load():
    contents = []
    for _ in range(2):
        with drawing(2.0, 1.0) as figure:
            figure.subplots().plot([0, 1], [1, 0])
            contents.append(picture_content(figure))
    assert contents[0] == contents[1]
    svg = contents[0].decode()
    assert not re.search(r"(?:href|src)\s*=\s*[\"'](?!#)", svg)
    assert "<date" not in svg.lower().replace("dc:", "<")


def test_the_address_of_a_picture_says_of_what_kind_it_is():
    with drawing(0.5, 0.5) as figure:
        kinds = [ReportPicture(picture_content(figure, kind), "", "").uri.split(";")[0] for kind in ("svg", "png")]
    assert kinds == ["data:image/svg+xml", "data:image/png"]
