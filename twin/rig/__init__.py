"""The rig: a real joint on a cable, played with a designed input; wiring, calibration, and the twin in its place."""
