"""Cases are read only from a folder that is the user's own, because an accepted model comes from
it."""

import os
from pathlib import Path

import pytest

from dehyst.daemon.files.cases import CASE, case_folders


def test_a_folder_that_others_may_write_into_holds_no_cases(tmp_path: Path) -> None:
    folder = tmp_path / "mismatch"
    (folder / "mismatch-1.case").mkdir(parents=True)
    (folder / "mismatch-1.case" / CASE).write_text("{}")
    folder.chmod(0o755)
    found = case_folders(folder)
    assert [one.name for one in found] == ["mismatch-1.case"]
    for mode in (0o777, 0o775, 0o757, 0o1777):
        folder.chmod(mode)
        assert case_folders(folder) == []


@pytest.mark.skipif(os.geteuid() != 0, reason="only root can give a folder away")
def test_a_folder_of_another_user_holds_no_cases(tmp_path: Path) -> None:
    folder = tmp_path / "mismatch"
    (folder / "mismatch-1.case").mkdir(parents=True)
    (folder / "mismatch-1.case" / CASE).write_text("{}")
    os.chown(folder, 12345, 12345)
    assert case_folders(folder) == []
