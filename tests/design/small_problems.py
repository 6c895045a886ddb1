"""Problems whose answers are known by hand, on a mechanism that compiles at once."""

import jax
import jax.numpy as jnp
import numpy as np

import jaxkin as jk
from jaxkin.design import Measured, Objective, Problem


@jk.mechanism
class Cart(jk.Mechanism):
    """A carriage: x = a q + b."""

    pose_axes = (jk.Axis("x", "length"),)
    joint_axes = (jk.Axis("q", "length"),)
    a: jax.Array
    b: jax.Array
    limits: jk.Limits

    def constraints(self, pose, joints):
        return pose - self.a * joints - self.b

    def characteristic_length(self):
        return jnp.ones(())


def cart(a=0.7, b=0.9):
    return Cart(jnp.asarray(a, float), jnp.asarray(b, float), jk.Limits.lengths(1, low=-5.0, high=5.0))


def quantity(name, function):
    """An objective that is a smooth function of a and b."""

    def parts(robot, center):
        del center
        return jnp.asarray(function(robot.a, robot.b), float)[None]

    def measured(robot, center):
        return Measured(float(parts(robot, center)[0]), 1e-15)

    return Objective(name, "1", parts, "only", 0.0, "none", measured, content={"objective": name})


BOWL = quantity("bowl", lambda a, b: (a - 1.0) ** 2 + (b - 2.0) ** 2)
SUM = quantity("sum", lambda a, b: a + b)
SQUARE = {"a": (0.0, 3.0), "b": (0.0, 3.0)}


def problem(vary=None, subject_to=(), minimise=BOWL, **options):
    return Problem(cart(), vary=vary or SQUARE, minimise=minimise, subject_to=subject_to, **options)


def numbers(design):
    """What has to be the same bit for bit."""
    history = {name: np.asarray(value).tobytes() for name, value in design.history.data_vars.items()}
    told = design.to_json()
    told["counts"].pop("seconds")
    return told, history
