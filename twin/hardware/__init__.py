"""The parts of the leg as numbers: motor, friction, drive, potentiometer, linkage."""
