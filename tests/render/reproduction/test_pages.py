"""Pages: plain texts are escaped, pictures are inside, nothing is loaded."""

import base64
import re

from palpate.render.reproduction.pages import html_page
from palpate.render.reproduction.pictures import drawing, picture_uri
from palpate.render.reproduction.sections import ReportPicture, ReportRow, ReportSection, ReportTable

TABLE = ReportTable("Further <numbers>", ("name", "number"), (("cube", "1.5"),))
PICTURE = ReportPicture("data:image/png;base64,AAAA", 'a "plot"', "Below.")
ROW = ReportRow("r | cube", "2.54", "3 < 4", "unknown & assumed")
SECTION = ReportSection("Figure 6C", "Text with <b>.", (ROW,), (TABLE,), (PICTURE,))


def test_texts_are_escaped_in_html():
    page = html_page("Title <x>", "Introduction & more", [SECTION], "footer")
    assert "<title>Title &lt;x&gt;</title>" in page
    assert "Text with &lt;b&gt;." in page
    assert "<td>3 &lt; 4</td>" in page
    assert '<img alt="a &quot;plot&quot;" src="data:image/png;base64,AAAA">' in page
    assert page.count("<table") == page.count("</table>") == 2


def test_pictures_are_the_same_every_time_and_name_no_page_to_load():
    uris = []
    for _ in range(2):
        with drawing(2.0, 1.0) as figure:
            figure.subplots().plot([0, 1], [1, 0])
            uris.append(picture_uri(figure))
    assert uris[0] == uris[1]
    svg = base64.b64decode(uris[0].partition(",")[2]).decode()
    assert not re.search(r"(?:href|src)\s*=\s*[\"'](?!#)", svg)
    assert "<date" not in svg.lower().replace("dc:", "<")
