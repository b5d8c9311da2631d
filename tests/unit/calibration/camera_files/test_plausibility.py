"""What few cameras have is told, and what is usual is not."""

from calibration import CameraModel
from calibration.camera_files import doubts


def camera(fx=650.0, fy=650.0, cx=400.0, cy=250.0, terms=(0, 0, 0, 0, 0), size=(800, 500), **made):
    return CameraModel(image_size=size, K=[[fx, 0, cx], [0, fy, cy], [0, 0, 1]], distortion=list(terms), made=made)


def test_an_ordinary_camera_raises_no_doubt():
    assert doubts(camera()) == ()
    assert doubts(camera(cx=430, fy=640, terms=(-0.28, 0.08, 0, 0, 0))) == ()


def test_a_matrix_of_another_size_is_doubted():
    assert "641 x 361" in doubts(camera(cx=320, cy=180))[0]
    assert doubts(camera(cx=320, cy=180, area="a part of a larger picture")) == ()
    assert doubts(camera(cx=320, cy=180, size=(0, 0))) == ()


def test_stretched_pictures_and_lenses_that_fold_are_doubted():
    assert "fx / fy is 1.333" in doubts(camera(fx=866.6))[0]
    assert "54% of the picture has no direction" in doubts(camera(terms=(-0.9, 0.1, 0, 0, 0)))[0]
