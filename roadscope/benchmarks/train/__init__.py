"""Trains the camera detector from rendered pictures, and drivers in traffic."""

from roadscope._lazy import lazy_names

_PARTS = {
    "camera": "PRIOR TrainingResult evaluate fitted_calibration logistic train_camera",
    "crops": "ShuffledPictures Window batch cut_out draw_window objects_in relight relit",
    "driver": "DriverRecipe action_of train_driver",
    "loss_functions": "CropObjects TargetMaps box_loss boxes_of heat_loss losses targets_of",
    "pictures": "PictureEpisode Pictures PixelSize read_pictures render store_pictures",
    "recipe": "CALIBRATION_SEEDS FAULTS GREATEST_SEVERITY HELD_OUT_BODIES HELD_OUT_FAULTS RECIPES "
    "Recipe TEST_SEEDS TRAIN_SEEDS draw_episodes held_out_episodes split_episodes",
    "training": "Optimiser Trainer train",
}
"""Names by the file that defines them, loaded when first used: the face of this folder."""

__getattr__, __dir__ = lazy_names(__name__, parts=_PARTS)
