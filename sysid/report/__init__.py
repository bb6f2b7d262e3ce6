"""The page that shows a workflow's numbers: sections, figures, HTML."""
