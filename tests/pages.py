"""What a page of a report must be, and a summary that two runs must share."""

import re

from sysid.report.page import SCRIPT


def assert_stands_alone(html: str) -> None:
    """A page that needs no network: pictures within, links to itself alone, and to the script beside it."""
    markup = re.sub(r"(<script\b[^>]*>).*?</script>", r"\1", html, flags=re.DOTALL)  # scripts write links of their own
    sources = re.findall(r"""(?:src|href)=["']([^"']*)""", markup)
    assert sources
    assert all(source.startswith(("data:image/png;base64,", "#", SCRIPT)) for source in sources)
    assert "url(" not in markup


def without_seconds(value):
    """A summary but for what a clock says."""
    if isinstance(value, dict):
        return {k: without_seconds(v) for k, v in value.items() if k != "seconds"}
    return [without_seconds(v) for v in value] if isinstance(value, list) else value
