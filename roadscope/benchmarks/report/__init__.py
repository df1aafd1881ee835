"""Shows results as tables, files and pictures."""

from roadscope._lazy import lazy_names

_PARTS = {
    "board_files": "check_targets earlier_boards label_of",
    "breakdowns": "breakdown_tables note",
    "curves": "draw_curves has_curves",
    "export": "draw_boards latex_text save_all to_csv to_latex to_markdown",
    "moments": "worst_moments",
    "page": "MOST_BYTES PAGE Run read_runs save_moments save_page",
    "replay_records": "ReplayMoment",
    "tables": "agreement_lines board_table comparison explanation failure_lines footnote "
    "prediction_note prediction_rows prediction_table",
    "track_files": "folder_names save_tracks",
}
"""Names by the file that defines them, loaded when first used: the face of this folder."""

__getattr__, __dir__ = lazy_names(__name__, parts=_PARTS)
