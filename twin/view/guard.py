"""Access to the web viewer: only pages that it served itself, under this machine's own names.

A browser on this machine also runs pages of other sites, which can reach the loopback. Their requests show it: Host has
a foreign name that points to 127.0.0.1 (DNS rebinding), Origin has the foreign page, and browsers add Sec-Fetch-Site.
"""

from collections.abc import Callable
from typing import Any, Protocol

OWN = ("localhost", "127.0.0.1", "[::1]")
CLOSED = ("/drop",)  # a model dropped on the page: its MJCF can name any file of this machine and so show it
OPEN_TO_ALL = "Access-Control-Allow-Origin"


class Headers(Protocol):
    """The headers of a request; names in any case."""

    def get_all(self, key: str) -> list[str]:
        """Every value of a header."""
        ...


def refusal(path: str, headers: Headers, port: int) -> str | None:
    """Why a request for `path` at `port` is refused; None if it is allowed."""
    hosts = {f"{name}:{port}" for name in OWN} | ({*OWN} if port == 80 else set())
    asked = headers.get_all("Host")
    if len(asked) != 1 or asked[0].lower() not in hosts:
        return f"This viewer answers only to http://localhost:{port}/."
    origins = {f"http://{host}" for host in hosts}
    if any(origin.lower() not in origins for origin in headers.get_all("Origin")):
        return f"This viewer answers only to its own page at http://localhost:{port}/."
    if not _own_page_or_person(headers):
        return f"This viewer is not part of other pages; open http://localhost:{port}/."
    if path.partition("?")[0] in CLOSED:
        return "This viewer loads no other model."
    return None


def _own_page_or_person(headers: Headers) -> bool:
    """Whether the request comes from the viewer's own page or from a person who opens it; old browsers do not say."""
    sites = headers.get_all("Sec-Fetch-Site")
    opened = headers.get_all("Sec-Fetch-Mode") == ["navigate"] and headers.get_all("Sec-Fetch-Dest") == ["document"]
    return all(site in ("same-origin", "none") for site in sites) or opened


def guarded(serve: Callable[..., Any]) -> Callable[..., Any]:
    """`websockets.asyncio.server.serve` that checks every request, also for a WebSocket: a refused one gets 403."""

    def checked(handler: Any, *, sock: Any, process_request: Any, process_response: Any, **options: Any) -> Any:
        port = sock.getsockname()[1]

        def request_first(connection: Any, request: Any) -> Any:
            reason = refusal(request.path, request.headers, port)
            return process_request(connection, request) if reason is None else connection.respond(403, reason + "\n")

        def response_last(connection: Any, request: Any, response: Any) -> Any:
            answer = process_response(connection, request, response) or response
            if OPEN_TO_ALL in answer.headers:
                del answer.headers[OPEN_TO_ALL]  # this header would let pages of any site read the answer
            return answer

        return serve(handler, sock=sock, process_request=request_first, process_response=response_last, **options)

    return checked
