"""The page in the browser: from a log to a model, in a folder that opens again.

What the page knows and does is in modules without a drawing framework (`entries`, `session`, `jobs`, `tasks`, `desk`,
`figures`); `page` shows it with NiceGUI, and `server` runs it on the loopback behind a guard.
"""
