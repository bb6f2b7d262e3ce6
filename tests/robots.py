"""Robots as MJCF with hidden values, and logs of them made step by step with MuJoCo alone, apart from `twin.mjcf`."""

import mujoco
import numpy as np

HIP, KNEE = "hip_servo", "knee_servo"
PENDULUM = """
<mujoco model="pendulum">
  <option timestep="0.002" integrator="implicitfast"/>
  <default><geom contype="0" conaffinity="0"/></default>
  <worldbody>
    <body pos="0 0 1">
      <joint name="hip" axis="0 1 0"/>
      <geom type="capsule" fromto="0 0 0 0 0 -.3" size=".03"/>
      <body pos="0 0 -.3">
        <joint name="knee" axis="0 1 0"/>
        <geom type="capsule" fromto="0 0 0 0 0 -.25" size=".02"/>
      </body>
    </body>
  </worldbody>
  <actuator>
    <position name="hip_servo" joint="hip" kp="40" kv="1"/>
    <position name="knee_servo" joint="knee" kp="20" kv="0.4"/>
  </actuator>
</mujoco>
"""
CART = """
<mujoco model="cart">
  <option timestep="0.002"/>
  <worldbody>
    <body>
      <joint name="slide" type="slide" axis="1 0 0" stiffness="30" damping="0.3"/>
      <geom size=".1" mass="1"/>
      <body>
        <joint name="hinge" axis="0 1 0" stiffness="4" damping="0.3"/>
        <geom type="capsule" fromto="0 0 0 0 0 -.4" size=".02" contype="0"/>
      </body>
    </body>
  </worldbody>
  <actuator>
    <motor name="cart" joint="slide" gear="2" ctrlrange="-20 20"/>
    <motor name="pole" joint="hinge" ctrlrange="-20 20"/>
  </actuator>
</mujoco>
"""
SERVO = """
<mujoco model="servo">
  <option timestep="0.002" integrator="implicitfast"/>
  <worldbody>
    <body>
      <joint name="hinge" axis="0 1 0" damping="0.1" armature="0.005" frictionloss="0.1"/>
      <geom type="capsule" fromto="0 0 0 0 0 -.25" size=".02"/>
    </body>
  </worldbody>
  <actuator><position name="servo" joint="hinge" kp="20" kv="0.4"/></actuator>
</mujoco>
"""
MOTOR = """
<mujoco model="motor">
  <option timestep="0.002"/>
  <worldbody>
    <body>
      <joint name="hinge" axis="0 1 0" damping="0.15" armature="0.01" frictionloss="0.05"/>
      <geom type="capsule" fromto="0 0 0 0 0 -.3" size=".03"/>
    </body>
  </worldbody>
  <actuator><motor name="motor" joint="hinge" gear="2" ctrlrange="-5 5"/></actuator>
</mujoco>
"""
TRUTH = {
    "hip_servo.armature": 0.03,
    "knee_servo.armature": 0.012,
    "hip_servo.damping": 0.6,
    "knee_servo.damping": 0.2,
    "hip_servo.frictionloss": 0.4,
    "knee_servo.frictionloss": 0.25,
    "delay": 0.009,
    "hip_servo.bias": 0.04,
    "knee_servo.bias": -0.03,
}


def chirp(t, low=0.2, high=3.0, amplitude=0.5):
    """A sweep of frequency [Hz] over t (N,) [s]."""
    return amplitude * np.sin(2.0 * np.pi * (low * t + (high - low) / (2.0 * t[-1]) * t**2))


def levels(rng, n, N, each, amplitude=0.6):
    """Random levels (N, n), `each` samples long."""
    return np.repeat(rng.uniform(-amplitude, amplitude, (N // each + 1, n)), each, axis=0)[:N]


def record(xml, truth, names, u, Ts, noise, rng, keep=lambda spec: spec, force=None):
    """Readings y (N, n) of actuators `names` under u (N, n), held for Ts [s], of a robot with the hidden values.

    The encoders read the angle plus the bias, and the servos control what they read. `keep` changes the spec; `force`
    of positions and speeds (n,) acts at the joints beside the model's own.
    """
    spec = keep(mujoco.MjSpec.from_string(xml))
    for name in names:
        joint = spec.joint(spec.actuator(name).target)
        for field in ("armature", "frictionloss"):
            setattr(joint, field, truth.get(f"{name}.{field}", getattr(joint, field)))
        joint.damping[0] = truth.get(f"{name}.damping", joint.damping[0])
    model = spec.compile()
    data, h = mujoco.MjData(model), model.opt.timestep
    bias = np.array([truth.get(f"{name}.bias", 0.0) for name in names])
    ids = [model.actuator(name).id for name in names]
    places = [int(model.jnt_qposadr[model.actuator_trnid[k, 0]]) for k in ids]
    dofs = [int(model.jnt_dofadr[model.actuator_trnid[k, 0]]) for k in ids]
    servo = np.array([model.actuator_biasprm[k, 1] != 0.0 for k in ids])
    data.qpos[places] = np.where(servo, u[0], 0.0) - bias
    every, y = round(Ts / h), np.zeros(u.shape)
    for step in range(len(u) * every):
        if step % every == 0:
            y[step // every] = data.qpos[places] + bias
        start = (step * h - truth["delay"]) / Ts  # [samples]: within a step the late command changes once at most
        k = int(np.floor(start))
        share = min((k + 1 - start) * Ts / h, 1.0)
        old, new = (u[min(max(each, 0), len(u) - 1)] for each in (k, k + 1))
        data.ctrl[ids] = share * old + (1.0 - share) * new - servo * bias
        if force is not None:
            data.qfrc_applied[dofs] = force(data.qpos[places], data.qvel[dofs])
        mujoco.mj_step(model, data)
    return y + noise * rng.standard_normal(y.shape)


def write_table(path, names, u, y, Ts):
    """A log as a person has it: seconds, commands in rad, positions in degrees."""
    heads = ["time [s]", *(f"{n} command [rad]" for n in names), *(f"{n} angle [deg]" for n in names)]
    rows = np.column_stack([np.arange(len(u)) * Ts, u, np.degrees(y)])
    np.savetxt(path, rows, delimiter=",", comments="", header=",".join(heads), fmt="%.7g")
