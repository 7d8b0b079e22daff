"""The emulated GNSS receiver: position and velocity of its antenna.

With the lever arm l from the reference point to the antenna in the body frame, these are
``p + C_b_n l`` and ``v + C_b_n (ω_ib^b x l) - ω_ie^n x C_b_n l`` (Groves, *Principles of GNSS,
Inertial, and Multisensor Integrated Navigation Systems*, 2nd ed., 2013, (2.165), (2.166)). The
receiver knows the antenna's own local frame, which is turned against that of the reference point:
by l_east tan φ / R about the vertical, which matters at high latitudes.

A fix is measured at the end of an epoch and sent, as a group of five frames, some epochs later:
it carries its time of validity on SYNC's clock, and the standard deviations of its errors: white
noise and, for the position, a first-order Gauss-Markov process per component, as multipath and the
ionosphere leave it (section 9.4.2).
During an outage the groups go on, and say that there is no fix.
"""

from __future__ import annotations

import math

import numpy as np

from rrins.compiled.compilation import compiled
from rrins.compiled.record import Floats
from rrins.dbc.codec import encode, pack, unwrapped
from rrins.dbc.contract import Contract
from rrins.dbc.e2e import fill
from rrins.dbc.frame import FrameArray
from rrins.host_tools.hardware import earth, motion
from rrins.host_tools.hardware.memory import GnssState, Plant, Truth
from rrins.host_tools.hardware.noise import normal

_TIME, _LATITUDE, _LONGITUDE, _HEIGHT, _VELOCITY = range(5)
_FIX_3D = 2  # of GNSS_TIME.quality; 0: no fix


@compiled
def measures(plant: Plant) -> bool:
    """Return whether the receiver measures in this epoch; the truth of the epoch is needed then."""
    return plant.gnss.fitted and plant.epoch % plant.gnss.interval_epochs == 0


@compiled
def _has_fix(gnss: GnssState, epoch: int) -> bool:
    if gnss.lost:
        return False
    for k in range(gnss.outage_count):
        if gnss.outage_first[k] <= epoch <= gnss.outage_last[k]:
            return False
    return True


@compiled
def _correlate(gnss: GnssState) -> None:
    """Let the errors that last go on to this fix."""
    share = gnss.correlated_share if gnss.correlated_begun else 0.0
    drive = gnss.position_correlated_noise * math.sqrt(1.0 - share * share)
    for i in range(3):
        gnss.correlated[i] = share * gnss.correlated[i] + drive * normal(gnss, 0)
    gnss.correlated_begun = True


@compiled
def _turn(truth: Truth, vector: Floats) -> None:
    """Turn a vector of the body into the navigation frame, in place: Rz(-heading) Rx(pitch) Ry."""
    sr, cr = math.sin(truth.roll), math.cos(truth.roll)
    sp, cp = math.sin(truth.pitch), math.cos(truth.pitch)
    sh, ch = math.sin(truth.heading), math.cos(truth.heading)
    right, level = cr * vector[0] + sr * vector[2], cr * vector[2] - sr * vector[0]
    ahead, up = cp * vector[1] - sp * level, sp * vector[1] + cp * level
    vector[0], vector[1], vector[2] = ch * right + sh * ahead, ch * ahead - sh * right, up


@compiled
def _place_antenna(plant: Plant, pieces: Floats) -> None:
    """Write the antenna's position and velocity against the reference point, in n."""
    gnss, truth = plant.gnss, plant.truth
    arm, moving = gnss.antenna_n, gnss.antenna_velocity_n
    for i in range(3):
        arm[i] = gnss.lever_arm[i]
        moving[i] = 0.0
    _turn(truth, arm)
    index = motion.piece_of(plant, plant.epoch)
    if index < 0:
        return
    end = motion.begin_of(plant, plant.epoch) + 1.0 / plant.piece_epochs
    for i in range(3):
        one, two = (i + 1) % 3, (i + 2) % 3
        rate_one = motion.value(pieces[index], motion.RATE + one, end)
        rate_two = motion.value(pieces[index], motion.RATE + two, end)
        moving[i] = rate_one * gnss.lever_arm[two] - rate_two * gnss.lever_arm[one]
    _turn(truth, moving)
    north = earth.ROTATION_RATE * math.cos(truth.latitude)
    up = earth.ROTATION_RATE * math.sin(truth.latitude)
    east_m_s, north_m_s, up_m_s = (
        truth.velocity_n[0] + moving[0] - north * arm[2] + up * arm[1],
        truth.velocity_n[1] + moving[1] - up * arm[0],
        truth.velocity_n[2] + moving[2] + north * arm[0],
    )
    # From the reference point's local frame to the antenna's.
    north_m, east_m = earth.metres_per_rad(truth.latitude, truth.height)
    about_east = -arm[1] / north_m
    about_north = arm[0] * math.cos(truth.latitude) / east_m
    about_up = arm[0] * math.sin(truth.latitude) / east_m
    moving[0] = east_m_s - about_north * up_m_s + about_up * north_m_s - truth.velocity_n[0]
    moving[1] = north_m_s - about_up * east_m_s + about_east * up_m_s - truth.velocity_n[1]
    moving[2] = up_m_s - about_east * north_m_s + about_north * east_m_s - truth.velocity_n[2]


@compiled
def measure(plant: Plant, pieces: Floats, contract: Contract) -> None:
    """Measure at the end of this epoch; keep the payloads until they are due."""
    gnss, truth = plant.gnss, plant.truth
    gnss.waiting = True
    gnss.epoch = plant.epoch
    noise = gnss.position_noise
    east, north, up = noise * normal(gnss, 0), noise * normal(gnss, 0), noise * normal(gnss, 0)
    time = contract.gnss_time
    word = pack(np.uint64(0), time.time_us, plant.epoch * plant.period_ns // 1000)
    has_fix = _has_fix(gnss, plant.epoch)
    if has_fix:
        word = pack(word, time.quality, _FIX_3D)
        word = encode(word, time.position_sigma, gnss.position_sigma)
        word = encode(word, time.velocity_sigma, gnss.velocity_sigma)
    gnss.word[_TIME] = word
    share = 1.0 if has_fix else 0.0
    if gnss.position_correlated_noise > 0.0:
        _correlate(gnss)
        east, north = east + gnss.correlated[0], north + gnss.correlated[1]
        up += gnss.correlated[2]
    wrong = gnss.fault_position
    east, north, up = east + wrong[0], north + wrong[1], up + wrong[2]
    if gnss.has_lever_arm:
        _place_antenna(plant, pieces)
        arm = gnss.antenna_n
        east, north, up = east + arm[0], north + arm[1], up + arm[2]
    north_m, east_m = earth.metres_per_rad(truth.latitude, truth.height)
    latitude = math.degrees(truth.latitude + north / north_m) * share
    longitude = math.degrees(truth.longitude + east / east_m) * share
    message = contract.gnss_latitude
    gnss.word[_LATITUDE] = encode(np.uint64(0), message.latitude_deg, latitude)
    beside = contract.gnss_longitude
    longitude = unwrapped(longitude, 0.0, 360.0)
    gnss.word[_LONGITUDE] = encode(np.uint64(0), beside.longitude_deg, longitude)
    vertical = contract.gnss_height
    word = encode(np.uint64(0), vertical.height, (truth.height + up) * share)
    noise = gnss.velocity_noise
    east, north, up = noise * normal(gnss, 0), noise * normal(gnss, 0), noise * normal(gnss, 0)
    wrong = gnss.fault_velocity
    east, north, up = east + wrong[0], north + wrong[1], up + wrong[2]
    if gnss.has_lever_arm:
        moving = gnss.antenna_velocity_n
        east, north, up = east + moving[0], north + moving[1], up + moving[2]
    velocity = truth.velocity_n
    gnss.word[_HEIGHT] = encode(word, vertical.velocity_up, (velocity[2] + up) * share)
    level = contract.gnss_velocity
    word = encode(np.uint64(0), level.velocity_east, (velocity[0] + east) * share)
    word = encode(word, level.velocity_north, (velocity[1] + north) * share)
    gnss.word[_VELOCITY] = word


@compiled
def is_due(plant: Plant) -> bool:
    """Return whether the group of the last fix is sent in this epoch."""
    gnss = plant.gnss
    return gnss.waiting and plant.epoch == gnss.epoch + gnss.latency_epochs


@compiled
def send(plant: Plant, contract: Contract, outbox: FrameArray, count: int) -> int:
    """Append the five frames of the last fix; return the new number of frames."""
    word, epoch = plant.gnss.word, plant.epoch
    fill(outbox[count], contract.gnss_time.message, word[_TIME], epoch)
    fill(outbox[count + 1], contract.gnss_latitude.message, word[_LATITUDE], epoch)
    fill(outbox[count + 2], contract.gnss_longitude.message, word[_LONGITUDE], epoch)
    fill(outbox[count + 3], contract.gnss_height.message, word[_HEIGHT], epoch)
    fill(outbox[count + 4], contract.gnss_velocity.message, word[_VELOCITY], epoch)
    return count + 5
