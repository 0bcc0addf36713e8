"""What a reader of the code may rely on."""

from tests.structure import GENERATED, PRODUCT, ROOT, import_circle, imported, sizes, walks


def test_no_modules_import_each_other_in_a_circle() -> None:
    assert import_circle() == []


def test_a_circle_would_be_found() -> None:
    """The search sees what a module imports."""
    path = ROOT / "litegripd/recorder/recorder.py"
    modules = {"litegripd.model.motor": path, "litegripd.model.state": path}
    assert set(imported(path, modules)) == set(modules)


def test_walks_enter_files_of_the_product() -> None:
    for name, files in walks().items():
        assert len(files) > 3, name
        assert set(files) <= set(sizes(*PRODUCT)) | set(GENERATED)
