import pytest
from retime_cases import URDF, WAY
from sizing_cases import GEAR, MOTOR, write_catalog


@pytest.fixture
def files(tmp_path, monkeypatch):
    (tmp_path / "table.urdf").write_text(URDF)
    (tmp_path / "table.yaml").write_text(
        "pinfric: 1\nrobot: {urdf: table.urdf}\n"
        "friction: {table: {coulomb: {static: 3.0, kinetic: 3.0}}}\n"
    )
    (tmp_path / "way.yaml").write_text(WAY)
    motors = {
        "small": MOTOR | {"peak_torque": 0.6},
        "large": MOTOR | {"peak_torque": 1.2, "mass": 0.9},
    }
    write_catalog(tmp_path / "catalog.yaml", motors, {"G": GEAR | {"repeated_peak_torque": 95.0}})
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "80")
    return tmp_path
