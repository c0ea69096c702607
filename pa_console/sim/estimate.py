"""A small Kalman filter: position and velocity of a contact from noisy measurements.

Constant velocity with random acceleration; both axes have the same covariance, as measurement
noise has no direction. It draws nothing, so equal detections give equal estimates.
"""

from pa_console.schema.base import Point
from pa_console.sim.sensing_state import TrackFile

ACCELERATION_MPS2 = 1.0
"""One sigma of the acceleration that a contact may show at any time."""
SPEED_SIGMA_MPS = 8.0
"""One sigma of the speed on each axis of a contact of which nothing is known yet."""
LEAST_SIGMA_M = 0.05
_SURPRISE = 18.4
"""Squared error in sigmas that two dimensions exceed once in ten thousand measurements."""


def measure(file: TrackFile, at: Point, sigma_m: float, tick: int, dt_s: float) -> None:
    """Take in a measurement made at `tick`; an older one than the latest is first moved ahead.

    A surprising one means that the contact has changed its motion: its speed is learned anew.
    """
    noise = max(sigma_m, LEAST_SIGMA_M) ** 2
    if file.variance == 0.0:
        (file.x, file.y), file.variance = at, noise
        file.covariance, file.speed_variance = 0.0, SPEED_SIGMA_MPS**2
        return
    elapsed = (tick - file.tick) * dt_s
    if elapsed > 0.0:
        _predict(file, elapsed)
        file.tick = tick
    elif elapsed < 0.0:
        at = (at[0] - elapsed * file.vx, at[1] - elapsed * file.vy)
        noise += file.speed_variance * elapsed**2
    error_x, error_y = at[0] - file.x, at[1] - file.y
    spread = file.variance + noise
    if error_x**2 + error_y**2 > _SURPRISE * spread:
        file.variance += error_x**2 + error_y**2
        file.covariance, file.speed_variance = 0.0, SPEED_SIGMA_MPS**2
        spread = file.variance + noise
    gain, speed_gain = file.variance / spread, file.covariance / spread
    file.x += gain * error_x
    file.y += gain * error_y
    file.vx += speed_gain * error_x
    file.vy += speed_gain * error_y
    file.speed_variance -= speed_gain * file.covariance
    file.covariance *= 1.0 - gain
    file.variance *= 1.0 - gain


def _predict(file: TrackFile, seconds: float) -> None:
    """Carry the estimate `seconds` ahead."""
    q = ACCELERATION_MPS2**2
    file.x += file.vx * seconds
    file.y += file.vy * seconds
    file.variance += (
        2.0 * file.covariance * seconds + file.speed_variance * seconds**2 + q * seconds**4 / 4.0
    )
    file.covariance += file.speed_variance * seconds + q * seconds**3 / 2.0
    file.speed_variance += q * seconds**2
