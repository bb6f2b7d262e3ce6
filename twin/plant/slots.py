"""The motor board's numbers in MuJoCo's user data: one name a place. HEAD of the board, then WIDTH for each joint.

Plain integers, so that compiled code can use them by name.
"""

# The board. MAGIC marks user data as the board's own: a model whose first number is another is left alone.
MAGIC_VALUE = 20161001.0
MAGIC = 0
JOINTS = 1
STEP = 2  # [s] of the simulation
PERIOD = 3  # simulation steps between two looks at commands, switches and potentiometers
SUPPLY = 4  # [V] without load
SUPPLY_R = 5  # [Ohm] of supply and wires
LEVELS = 6  # PWM levels from 0 to full; 0: continuous
DEAD_BAND = 7  # [V] that the bridge loses
SEED = 8  # of the noise in the servo loop
SENSOR = 9  # where the board's sensor begins in sensordata
FILTER = 10  # share of a new load that enters its average
BUS = 11  # [V] state: supply under load
HEAD = 12

# A joint. "Drive" is the rod [m, N] or the shoulder's gear output [rad, N m].
GEAR = 0  # rotor angle per drive position
CONSTANT = 1  # [V s/rad]
RESISTANCE = 2  # [Ohm]
INERTIA = 3  # of the rotor, at the drive
VISCOUS = 4
ROW_TYPE = 5  # of the dry friction among MuJoCo's constraints
ROW_ID = 6
COULOMB_UP = 7
COULOMB_DOWN = 8
STRIBECK = 9  # static friction is (1 + this) times Coulomb friction
STRIBECK_SPEED = 10
LOAD_FRICTION = 11
OFFSET = 12  # drive position less actuator length / gear
LOWER = 13  # limit switches
UPPER = 14
HINGE = 15  # address in qpos
PLAY = 16  # address in qpos; -1: none
POT_PLAY = 17  # the same if the potentiometer sees the play, else -1
SERVO = 18  # 1: the command is a reference
KP = 19
KI = 20
KD = 21
POT_SCALE = 22  # [V/rad]
POT_STEP = 23  # [rad]; 0: no ADC
POT_HALF = 24  # codes to one side
POT_NOISE = 25  # [rad]
POT_NONLINEARITY = 26  # [rad]
POT_WAVE = 27  # [rad/rad]
DUTY = 28  # state: part of the supply, -1 to 1
LOAD = 29  # state: averaged force of the drive on the link
INTEGRAL = 30  # state: of the servo's error [V s]
LAST = 31  # state: the servo's last reading [V]; NaN before the first
GIVEN = 32  # state: motor and dry friction on the drive in the last step; NaN before the first
SPEED = 33  # state: of the drive in the last step
FORCE_NOW = 34  # state: force of the drive on the link in the last step
WIDTH = 35

# What the sensor shows of each joint: angle between the links [rad], what the potentiometer would read without noise
# and ADC [rad], motor voltage [V], force of the drive on the link [N or N m].
ANGLE, READING, VOLTS, FORCE = range(4)
COLUMNS = 4
