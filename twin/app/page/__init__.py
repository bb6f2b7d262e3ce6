"""The page itself, drawn with NiceGUI; what it shows and does is in `twin.app.desk`."""
