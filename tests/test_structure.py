"""What a reader of the code may rely on."""

from tests.structure import (
    GENERATED,
    PRODUCT,
    ROOT,
    drawing,
    import_circle,
    imported,
    sizes,
    walks,
)


def test_no_modules_import_each_other_in_a_circle() -> None:
    assert import_circle() == []


def test_a_circle_would_be_found() -> None:
    """The search sees what a module imports."""
    path = ROOT / "litegripd/recorder/recorder.py"
    modules = {"litegripd.model.motor": path, "litegripd.model.state": path}
    assert set(imported(path, modules)) == set(modules)


def test_the_clients_rooms_lie_on_six_floors_and_nothing_leads_back_up() -> None:
    rooms = drawing("litegrip_client")
    assert rooms.floors <= 6
    assert rooms.up == []
    assert rooms.arrows > 20  # the count sees them
    assert drawing("litegrip_client", files=True).up == []


MOST_FILES = {
    "state.get": 9,
    "a grasp request": 20,
    "a tick of a grasp": 22,
    "LiteGrip.grasp()": 11,
}
"""What a reader opens to follow each walk; of the tick's, five are the simulator's."""

MOST_MODULES = 177
"""Of the daemon and its client, with what the client has for a fleet. The page and the fleet are
programs of their own; the modules of `litegrip` are the SDK's."""

FORMER_PLACE = 4
"""Lines of a module that only names what has moved, perhaps to two places."""


def test_walks_enter_files_of_the_product_and_no_more_than_a_reader_follows() -> None:
    found = walks()
    assert found.keys() == MOST_FILES.keys()
    for name, files in found.items():
        assert 3 < len(files) <= MOST_FILES[name], f"{name}: {files}"
        assert set(files) <= set(sizes(*PRODUCT)) | set(GENERATED)


def test_daemon_and_client_stay_in_few_modules() -> None:
    own = [
        name
        for name, lines in sizes("litegripd", "litegrip_client").items()
        if not ("__init__" in name or "/drop_in/" in name) and lines > FORMER_PLACE
    ]
    assert len(own) <= MOST_MODULES
