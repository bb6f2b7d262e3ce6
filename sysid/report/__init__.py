"""The report of a workflow: sections, figures, HTML."""
