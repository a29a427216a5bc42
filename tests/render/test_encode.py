"""Files: what is written is read, byte for byte the same each time; what is not a picture is refused."""

import io
import zipfile

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import array_shapes, arrays

from render import encode
from render.encode import SKY, BadPicture

images = array_shapes(min_dims=2, max_dims=2, max_side=24)


@given(depth=arrays(np.float32, images, elements=st.floats(2**-10, 60000, width=32)))
@settings(max_examples=40, deadline=None)
def test_depth_survives_to_fourteen_bits(depth, tmp_path_factory):
    path = tmp_path_factory.mktemp("depth") / "0000.npz"
    encode.write_depth(path, depth)
    back = encode.read_depth(path)
    assert back.dtype == np.float32
    assert np.all(np.abs(back - depth) <= depth * 2**-15)
    with np.load(path, allow_pickle=False) as loaded:
        assert loaded.files == ["depth"]
        assert np.array_equal(loaded["depth"], back)


def test_the_sky_survives_exactly(tmp_path):
    encode.write_depth(tmp_path / "sky.npz", np.full((3, 4), SKY, np.float32))
    assert np.all(encode.read_depth(tmp_path / "sky.npz") == 65504)


@given(seg=arrays(np.uint8, images))
@settings(max_examples=40, deadline=None)
def test_segmentation_survives(seg, tmp_path_factory):
    path = tmp_path_factory.mktemp("seg") / "0000.npz"
    encode.write_segmentation(path, seg)
    assert np.array_equal(encode.read_segmentation(path), seg)
    with np.load(path, allow_pickle=False) as loaded:
        assert loaded["seg"].dtype == np.uint8
        assert np.array_equal(loaded["seg"], seg)


def test_colour_survives_nearly_and_in_order(tmp_path):
    image = np.zeros((32, 48, 3), np.uint8)
    image[:, :16], image[:, 16:32], image[:, 32:] = (220, 30, 40), (30, 200, 60), (20, 40, 210)
    encode.write_rgb(tmp_path / "a.jpg", image)
    back = encode.read_rgb(tmp_path / "a.jpg")
    assert back.shape == image.shape
    assert np.abs(back.astype(int) - image)[:, [4, 24, 44]].max() < 12


def test_files_of_the_same_picture_are_the_same_bytes(tmp_path, monkeypatch):
    rng = np.random.default_rng(0)
    depth, seg = rng.uniform(1, 9, (40, 40)).astype(np.float32), rng.integers(0, 9, (40, 40)).astype(np.uint8)
    rgb = rng.integers(0, 255, (40, 40, 3)).astype(np.uint8)
    for writer, picture in ((encode.write_depth, depth), (encode.write_segmentation, seg), (encode.write_rgb, rgb)):
        writer(tmp_path / "one", picture)
        with monkeypatch.context() as patch:
            patch.setattr("time.time", lambda: 2e9)
            writer(tmp_path / "two", np.asfortranarray(picture) if picture.ndim == 2 else picture)
        assert (tmp_path / "one").read_bytes() == (tmp_path / "two").read_bytes()


@pytest.mark.parametrize(
    ("writer", "picture"),
    [
        (encode.write_rgb, np.zeros((4, 4), np.uint8)),
        (encode.write_rgb, np.zeros((4, 4, 3), np.float32)),
        (encode.write_depth, np.zeros((4, 4), np.float64)),
        (encode.write_depth, np.full((4, 4), np.nan, np.float32)),
        (encode.write_segmentation, np.zeros((4, 4), np.int64)),
    ],
)
def test_other_shapes_and_types_are_not_written(writer, picture, tmp_path):
    with pytest.raises(ValueError, match=r"must be|finite"):
        writer(tmp_path / "x", picture)
    assert not (tmp_path / "x").exists()


def npz(path, member, data):
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr(member, data)


def header(shape, dtype):
    text = io.BytesIO()
    np.lib.format.write_array_header_1_0(text, {"descr": dtype, "fortran_order": False, "shape": shape})
    return text.getvalue()


def test_pickles_are_refused(tmp_path):
    np.savez(tmp_path / "p.npz", depth=np.array([[{"a": 1}]], dtype=object))
    with pytest.raises(BadPicture):
        encode.read_depth(tmp_path / "p.npz")


def test_a_huge_header_is_refused_before_anything_is_allocated(tmp_path):
    npz(tmp_path / "h.npz", "depth.npy", header((10**6, 10**6), "<f4"))
    with pytest.raises(BadPicture, match="allowed"):
        encode.read_depth(tmp_path / "h.npz")


@pytest.mark.parametrize("length", [0, 63, 65])
def test_a_wrong_amount_of_data_is_refused(tmp_path, length):
    npz(tmp_path / "t.npz", "depth.npy", header((4, 4), "<f4") + bytes(length))
    with pytest.raises(BadPicture, match="needs 64 bytes"):
        encode.read_depth(tmp_path / "t.npz")


@pytest.mark.parametrize("shape", [(4,), (4, 4, 4)])
def test_what_is_not_an_image_is_refused(tmp_path, shape):
    np.savez(tmp_path / "n.npz", seg=np.zeros(shape))
    with pytest.raises(BadPicture, match="not an image"):
        encode.read_segmentation(tmp_path / "n.npz")


def test_other_files_are_refused_in_one_line_with_the_path(tmp_path):
    (tmp_path / "a").write_bytes(b"not a picture at all")
    np.savez(tmp_path / "b.npz", other=np.zeros((2, 2)))
    for reader in (encode.read_depth, encode.read_segmentation, encode.read_rgb):
        for name in ("a", "b.npz"):
            with pytest.raises(BadPicture) as error:
                reader(tmp_path / name)
            assert str(tmp_path / name) in str(error.value)
            assert "\n" not in str(error.value)


def test_a_huge_jpeg_is_refused_by_its_header(tmp_path):
    encode.write_rgb(tmp_path / "a.jpg", np.zeros((16, 16, 3), np.uint8))
    data = bytearray((tmp_path / "a.jpg").read_bytes())
    place = data.index(b"\xff\xc0")
    data[place + 5 : place + 9] = b"\xff\xff\xff\xff"
    (tmp_path / "a.jpg").write_bytes(data)
    with pytest.raises(BadPicture, match="allowed"):
        encode.read_rgb(tmp_path / "a.jpg")


def test_segmentation_of_the_release_is_stored_as_floats(tmp_path):
    np.savez_compressed(tmp_path / "r.npz", seg=np.array([[0.0, 3.0]]))
    assert encode.read_segmentation(tmp_path / "r.npz").tolist() == [[0, 3]]
