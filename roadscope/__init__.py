"""Evaluation of driving perception on synthetic LiDAR, camera and IMU data.

Importing the package makes its environments known to Gymnasium, see
`roadscope.envs.gym.registration`.
"""

from roadscope.envs.gym.registration import register_on_import

__version__ = "0.1.0"

register_on_import()
