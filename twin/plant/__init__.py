"""The simulated plant: MuJoCo's leg with the compiled motor board in every step."""
