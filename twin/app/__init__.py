"""The page in the browser: from a log to a model, in a folder that opens again.

What the page knows and does is in modules without a drawing framework (`session`, `jobs`, `tasks`, `script`,
`figures`, `leg`); `pages` shows it with NiceGUI, and `server` runs it on the loopback behind `guard`.
"""
