"""Suites, boards, runs, metrics, results and reports."""

from typing import TYPE_CHECKING

from roadscope._lazy import lazy_names

if TYPE_CHECKING:
    from roadscope.benchmarks.calibrating import RigCalibration, calibrate_rig, save_rig_calibration
    from roadscope.benchmarks.compare import CompareError, Comparison
    from roadscope.benchmarks.eligibility import Eligibility
    from roadscope.benchmarks.episode import Episode
    from roadscope.benchmarks.isolation import Limits
    from roadscope.benchmarks.listing import names_of
    from roadscope.benchmarks.loop import RunOptions
    from roadscope.benchmarks.recorded.mot import score_mot_results
    from roadscope.benchmarks.recorded.object_rules import score_kitti_object_results
    from roadscope.benchmarks.recorded.scores import score_kitti_results
    from roadscope.benchmarks.results import Results
    from roadscope.benchmarks.run_pictures import save_picture, save_video
    from roadscope.benchmarks.single import Summary, run_episode
    from roadscope.benchmarks.submissions import (
        Submission,
        SubmitError,
        submit,
        submit_kitti,
        submit_mot,
    )
    from roadscope.benchmarks.suite import BoardSettings, Suite
    from roadscope.benchmarks.suite_exports import (
        ExportError,
        ExportPlan,
        export_suite,
        plan_export,
    )
    from roadscope.benchmarks.suite_files import load_suite
    from roadscope.benchmarks.train.driver import DriverRecipe, DriverTraining, train_driver

_PLACES = {
    "BoardSettings": "roadscope.benchmarks.suite:BoardSettings",
    "CompareError": "roadscope.benchmarks.compare:CompareError",
    "Comparison": "roadscope.benchmarks.compare:Comparison",
    "DriverRecipe": "roadscope.benchmarks.train.driver:DriverRecipe",
    "DriverTraining": "roadscope.benchmarks.train.driver:DriverTraining",
    "Eligibility": "roadscope.benchmarks.eligibility:Eligibility",
    "Episode": "roadscope.benchmarks.episode:Episode",
    "ExportError": "roadscope.benchmarks.suite_exports:ExportError",
    "ExportPlan": "roadscope.benchmarks.suite_exports:ExportPlan",
    "Limits": "roadscope.benchmarks.isolation:Limits",
    "Results": "roadscope.benchmarks.results:Results",
    "RigCalibration": "roadscope.benchmarks.calibrating:RigCalibration",
    "RunOptions": "roadscope.benchmarks.loop:RunOptions",
    "Submission": "roadscope.benchmarks.submissions:Submission",
    "SubmitError": "roadscope.benchmarks.submissions:SubmitError",
    "Suite": "roadscope.benchmarks.suite:Suite",
    "Summary": "roadscope.benchmarks.single:Summary",
    "calibrate_rig": "roadscope.benchmarks.calibrating:calibrate_rig",
    "export_suite": "roadscope.benchmarks.suite_exports:export_suite",
    "load_suite": "roadscope.benchmarks.suite_files:load_suite",
    "names_of": "roadscope.benchmarks.listing:names_of",
    "plan_export": "roadscope.benchmarks.suite_exports:plan_export",
    "run_episode": "roadscope.benchmarks.single:run_episode",
    "save_picture": "roadscope.benchmarks.run_pictures:save_picture",
    "save_rig_calibration": "roadscope.benchmarks.calibrating:save_rig_calibration",
    "save_video": "roadscope.benchmarks.run_pictures:save_video",
    "score_kitti_object_results": "roadscope.benchmarks.recorded.object_rules:"
    "score_kitti_object_results",
    "score_kitti_results": "roadscope.benchmarks.recorded.scores:score_kitti_results",
    "score_mot_results": "roadscope.benchmarks.recorded.mot:score_mot_results",
    "submit": "roadscope.benchmarks.submissions:submit",
    "submit_kitti": "roadscope.benchmarks.submissions:submit_kitti",
    "submit_mot": "roadscope.benchmarks.submissions:submit_mot",
    "train_driver": "roadscope.benchmarks.train.driver:train_driver",
}
"""Public name -> `module:attribute`, loaded when first used."""

__all__ = [
    "BoardSettings",
    "CompareError",
    "Comparison",
    "DriverRecipe",
    "DriverTraining",
    "Eligibility",
    "Episode",
    "ExportError",
    "ExportPlan",
    "Limits",
    "Results",
    "RigCalibration",
    "RunOptions",
    "Submission",
    "SubmitError",
    "Suite",
    "Summary",
    "calibrate_rig",
    "export_suite",
    "load_suite",
    "names_of",
    "plan_export",
    "run_episode",
    "save_picture",
    "save_rig_calibration",
    "save_video",
    "score_kitti_object_results",
    "score_kitti_results",
    "score_mot_results",
    "submit",
    "submit_kitti",
    "submit_mot",
    "train_driver",
]

_PARTS = {
    "cache": "FolderError cache_dir cache_folder digest_of read_kept read_or_make write_atomically "
    "write_kept",
    "cached_files": "cache_usage clear_cache size_text",
    "calibrating": "CalibrationTrial PoseRow TargetPose TargetView calibrate_from_corners "
    "calibration_from_views held_out_error_px random_poses sufficient_poses target_prisms "
    "target_view target_views true_corners",
    "drive_steps": "drive imu_mounting moving_in",
    "episode": "check_episode sensed sensing_of timeline_of timeline_path",
    "fingerprints": "PACKAGE code_hash fingerprint package package_version sensing_hash "
    "timeline_hash",
    "graph": "FIRST_CALLS Job Node run_jobs",
    "images": "image_rows image_rows_of_scans pictures projection_of",
    "imu_check": "Motion MotionWindow doubt_of_accelerations doubt_of_imu doubt_of_turns "
    "doubt_of_wheels",
    "kinds": "DETECTOR Kind TRACKER entry_kind",
    "listing": "KINDS",
    "loop": "CallInput run_plugin",
    "noisy": "CLUTTER_SIZE_M NOISES NoiseModel NoisyDetections",
    "noisy_camera": "CAMERA_NOISES CameraNoise LIT NoisyCamera",
    "noisy_odometry": "EgoNoise ODOMETRY_NOISES noisy_poses",
    "odometry_runner": "RecordedImu RecordedWheels folder_estimates",
    "parked": "parked_among parked_centres parked_owners",
    "plugin_sources": "distribution_version plugin_hash source_hash",
    "records": "CallTimes EpisodeDetections EpisodeFusions EpisodeImageDetections EpisodePoses "
    "EpisodeRecord EpisodeTracks",
    "references": "LIDAR_ALONE check_ego check_pose_source detection_source image_source is_noise "
    "made_from_truth pose_source",
    "run": "RunError agreements plan",
    "run_manifest": "manifest",
    "run_pictures": "RunPictures",
    "store": "LOG_LENGTH Outcome Store StoreError StoredJob",
    "suite": "SPLITS Positive SuiteError check_names",
    "suite_exports": "read_manifest",
    "suite_files": "SUITES parse_suite",
    "suite_folders": "kitti_suite",
    "tables": "MEANINGS name_table speed_table",
    "workers": "BackendError EXTRAS WorkerError WorkerSettings in_parallel open_workers",
}
"""What else the tests of this repository use, by the file that defines it. It is not public."""

if not TYPE_CHECKING:
    __getattr__, __dir__ = lazy_names(__name__, _PLACES, _PARTS)
