"""`qpal app`: the whole workflow on a page in the browser."""

from pathlib import Path
from typing import Annotated

import typer

from twin.cli import console, options
from twin.cli.output import new_folder

Folder = Annotated[
    str | None,
    typer.Option(metavar="DIR", help="folder of the session, made or opened again; runs/<stamp>-app if not given"),
]


def app(
    session: Folder = None,
    port: Annotated[int, options.whole_number("N", "port on this machine; 0 takes the first free port from 8090")] = 0,
    no_browser: Annotated[
        bool, typer.Option("--no-browser", help="print the address only; open it yourself, token included")
    ] = False,
) -> None:
    """Work on logs and fits in the browser.

    The page has logs, preparation, fits, and the comparison with the twin; Ctrl-C ends it.

    Only this machine reaches the page, and only by the address that is printed. The session's folder keeps everything.

    Limit: until it is closed; a job can be cancelled. Progress: of the job.
    """
    from twin.app.desk import Desk
    from twin.app.server import listen, serve
    from twin.app.session import Session

    with listen(port) as listening:
        folder = Path(session) if session is not None else new_folder("app")
        desk = Desk(Session.open(folder))
        try:
            for complaint in desk.session.complaints:
                print(f"Note: {complaint}.")
            serve(
                desk, listening, not no_browser, lambda at: print(f"The page is at {at}\nCtrl-C ends it.", flush=True)
            )
        except KeyboardInterrupt:
            raise console.Interruption(
                f"the session is kept; open it again with: qpal app --session {folder}"
            ) from None
        finally:
            desk.close()


def _say(address: str) -> None:
    print(f"The page is at {address}\nCtrl-C ends it.", flush=True)
