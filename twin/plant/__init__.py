"""The plant as it is stepped: MuJoCo's leg with the motor board compiled into every step."""
