"""From a recorded file to final results."""
