"""What is not a file is refused at once, wherever a user may name it."""

import os
from pathlib import Path

import pytest

from skillctl.errors import InputDataError
from skillctl.opening import open_regular
from skillctl.simulation.scenario_file import read_scenario
from skillctl.usecases.manifest import read_manifest


@pytest.mark.parametrize("read", [open_regular, read_scenario, read_manifest])
@pytest.mark.parametrize("what", ["pipe.urdf", "/dev/zero", "."])
def test_a_pipe_a_device_or_a_directory_is_not_waited_for(tmp_path: Path, read, what) -> None:
    os.mkfifo(tmp_path / "pipe.urdf")
    with pytest.raises(InputDataError, match="is not a regular file"):
        read(tmp_path / what)
