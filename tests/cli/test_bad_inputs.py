"""Bad artifacts and bad stores: which test holds that each kind is refused as it should be.

At the command line that is one sentence, the right exit code, nothing written; the rooms' own tests try each
kind in depth.
"""

from __future__ import annotations

import ast
from pathlib import Path

TESTS = Path(__file__).parents[1]

HELD_BY = {
    "a flipped bit": "store/test_damage.py::test_every_bit_of_the_seal_and_samples_of_the_body_count",
    "cut at any length": "store/test_damage.py::test_every_truncation_is_refused",
    "bytes appended": "store/test_damage.py::test_appended_bytes_are_refused",
    "blocks zeroed or swapped": "store/test_damage.py::test_zeroed_and_swapped_blocks_are_refused",
    "another format": "store/test_damage.py::test_another_file_is_called_what_it_is",
    "HDF5 without a seal": "store/test_damage.py::test_a_plain_hdf5_body_without_its_seal_is_refused",
    "a text-mode transfer": "store/test_damage.py::test_a_text_mode_transfer_is_recognised",
    "no regular file": "store/test_damage.py::test_what_is_not_a_regular_file_is_refused_at_once",
    "10 GiB": "store/test_damage.py::test_a_huge_file_is_refused_by_its_size",
    "links": "store/test_hostile_structure.py::test_links_and_objects",
    "a user-defined link": "store/test_hostile_structure.py::test_a_user_defined_link",
    "external storage": "store/test_hostile_storage.py::test_external_storage_is_never_opened",
    "external storage, unwatched": (
        "cli/test_bad_artifacts.py::test_a_file_that_an_array_points_to_is_not_opened"
    ),
    "virtual, chunked, filtered": "store/test_hostile_storage.py::test_storage",
    "terabytes declared": "store/test_processes.py::test_a_hostile_file_costs_little_memory",
    "many large arrays": "store/test_hostile_storage.py::test_all_arrays_together_are_limited",
    "a thousand datasets": "store/test_hostile_structure.py::test_a_thousand_datasets_are_refused_unread",
    "a compressed bomb": "cli/test_bad_artifacts.py::test_a_resealed_file_is_refused_in_one_sentence",
    "a planted plugin": "store/test_hostile_storage.py::test_a_planted_filter_plugin_is_not_loaded",
    "element types": "store/test_hostile_storage.py::test_element_types",
    "integer types": "store/test_hostile_storage.py::test_integer_types",
    "groups, members, attributes by the thousand": "store/test_hostile_structure.py::test_amounts",
    "names": "store/test_hostile_structure.py::test_names",
    "missing members": "store/test_hostile_structure.py::test_missing_members",
    "not finite": "store/test_hostile_numbers.py::test_numbers_must_be_finite",
    "shapes": "store/test_hostile_storage.py::test_shapes",
    "priors and covariances": "store/test_hostile_numbers.py::test_numbers_must_form_a_skill",
    "barely unstable": "cli/test_bad_artifacts.py::test_what_is_almost_stable_is_read_and_not_proved",
    "metadata": "store/test_hostile_metadata.py::test_metadata_is_strict_json",
    "format versions": "store/test_hostile_versions.py::test_versions_in_the_seal",
    "names of skills": "store/test_references.py::test_names_that_are_refused",
    "references": "cli/test_bad_stores.py::test_references_that_are_malformed_or_lead_nowhere",
    "full, read-only and inode-less disks": (
        "store/test_interrupts.py::test_on_a_disk_that_refuses_old_versions_stay_whole_and_nothing_is_left"
    ),
    "no permission": "cli/test_bad_stores.py::test_without_permission_nothing_changes",
    "a limit on the size of files": (
        "cli/test_bad_stores.py::test_under_a_limit_on_the_size_of_files_nothing_changes"
    ),
    "a link for a directory": (
        "store/test_registry.py::test_a_link_in_place_of_a_skills_directory_is_not_followed"
    ),
    "a link for a version": "store/test_registry.py::test_a_planted_version_link_is_passed_over",
    "writers at once": (
        "store/test_processes.py::test_eight_writers_at_once_get_unique_numbers_without_gaps"
    ),
    "killed writers": (
        "store/test_processes.py::test_a_killed_writer_loses_nothing_it_reported_and_leaves_nothing_half"
    ),
    "SIGINT and SIGTERM": (
        "store/test_interrupts.py::test_a_signal_while_publishing_is_answered_on_standard_error"
    ),
    "a closed pipe": "cli/test_frame.py::test_a_closed_pipe_exits_141_in_silence",
    "a full standard output": "cli/test_frame.py::test_a_full_disk_under_standard_output_is_not_success",
    "three bad files of ten": (
        "cli/test_bad_artifacts.py::test_verification_names_exactly_the_bad_ones_of_ten"
    ),
    "the same bytes anywhere": (
        "store/test_processes.py::test_the_same_content_gives_the_same_bytes_in_any_process"
    ),
    "the same answer anywhere": "cli/test_bad_artifacts.py::test_the_surroundings_change_no_answer",
    "HDF5 that hangs the library": (
        "demonstrations/test_robomimic.py::test_a_file_that_libhdf5_never_finishes_is_given_up"
    ),
    "parsers that crash": "demonstrations/test_files.py::test_whatever_a_parser_does_ends_in_a_sentence",
    "a file swapped while it is read": (
        "store/test_damage.py::test_a_file_swapped_after_it_was_opened_changes_nothing"
    ),
}


def test_every_bad_input_has_its_test():
    for what, place in HELD_BY.items():
        path, name = place.split("::")
        tree = ast.parse((TESTS / path).read_text(encoding="utf-8"))
        assert name in {node.name for node in tree.body if isinstance(node, ast.FunctionDef)}, what
