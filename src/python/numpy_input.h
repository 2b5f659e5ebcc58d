#pragma once

#include <pybind11/numpy.h>
#include <pybind11/pybind11.h>

#include <algorithm>
#include <optional>
#include <string>
#include <vector>

#include "acmp_mapping/common/error.h"
#include "acmp_mapping/fusion/point_cloud.h"
#include "acmp_mapping/keyframe/frame.h"

/// What Python hands over as the library's types. All throw InvalidInputError that begins with `name`.
namespace acmp::python {

namespace py = pybind11;

inline std::string ShapeOf(const py::array& array) { return py::str(array.attr("shape")).cast<std::string>(); }

/// One of several: "K[3]".
inline std::string ElementName(const std::string& name, size_t index) { return Concat(name, "[", index, "]"); }

inline py::array AnyArray(const py::handle& value, const std::string& name) {
  py::array array = py::array::ensure(value);
  if (!array) throw InvalidInputError(name + ": must be an array");
  return array;
}

using Doubles = py::array_t<double, py::array::c_style | py::array::forcecast>;

/// Contiguous double precision numbers, from whatever numpy takes for such.
inline Doubles Numbers(const py::handle& value, const std::string& name) {
  const py::array array = AnyArray(value, name);
  const char kind = array.dtype().kind();
  if (kind != 'f' && kind != 'i' && kind != 'u') {
    throw InvalidInputError(
        Concat(name, ": dtype ", py::str(array.dtype()).cast<std::string>(), ": must be real numbers"));
  }
  return Doubles::ensure(array);
}

/// An array of this many elements along each axis; -1: any.
inline void CheckShape(const py::array& array, const std::string& name, const std::vector<py::ssize_t>& shape,
                       const std::string& wanted) {
  bool fits = array.ndim() == static_cast<py::ssize_t>(shape.size());
  for (size_t axis = 0; fits && axis < shape.size(); ++axis) {
    fits = shape[axis] < 0 || array.shape(static_cast<py::ssize_t>(axis)) == shape[axis];
  }
  if (!fits) throw InvalidInputError(Concat(name, ": shape ", ShapeOf(array), ": must be ", wanted));
}

/// The elements of a list or array.
inline std::vector<py::object> Elements(const py::handle& value, const std::string& name) {
  if (!py::isinstance<py::sequence>(value) && !py::isinstance<py::array>(value)) {
    throw InvalidInputError(name + ": must be a sequence");
  }
  std::vector<py::object> elements;
  for (const py::handle& element : value) elements.push_back(py::reinterpret_borrow<py::object>(element));
  return elements;
}

/// An element for each image.
inline std::vector<py::object> PerImage(const py::handle& value, const std::string& name, size_t images) {
  std::vector<py::object> elements = Elements(value, name);
  if (elements.size() == images) return elements;
  throw InvalidInputError(
      Concat(name, ": has ", elements.size(), " elements: must be one for each of ", images, " images"));
}

/// An (H, W) array of bytes or an (H, W, 3) one, with any strides.
inline ColorImage ToColorImage(const py::handle& value, const std::string& name, bool is_bgr) {
  const py::array array = AnyArray(value, name);
  if (!py::isinstance<py::array_t<uint8_t>>(array)) {
    throw InvalidInputError(Concat(name, ": dtype ", py::str(array.dtype()).cast<std::string>(), ": must be uint8"));
  }
  const bool is_gray = array.ndim() == 2;
  if (!is_gray) CheckShape(array, name, {-1, -1, 3}, "(height, width) or (height, width, 3)");
  ColorImage image(static_cast<int>(array.shape(1)), static_cast<int>(array.shape(0)));
  const py::array_t<uint8_t> bytes(array);
  for (int row = 0; row < image.height(); ++row) {
    for (int col = 0; col < image.width(); ++col) {
      const uint8_t* pixel = is_gray ? bytes.data(row, col) : bytes.data(row, col, 0);
      const py::ssize_t step = is_gray ? 0 : bytes.strides(2);
      image(col, row) = is_bgr ? Rgb{pixel[2 * step], pixel[step], *pixel} : Rgb{*pixel, pixel[step], pixel[2 * step]};
    }
  }
  return image;
}

/// An (H, W) array of bytes or bools.
inline Mask ToMask(const py::handle& value, const std::string& name) {
  const py::array array = AnyArray(value, name);
  if (!py::isinstance<py::array_t<uint8_t>>(array) && !py::isinstance<py::array_t<bool>>(array)) {
    throw InvalidInputError(
        Concat(name, ": dtype ", py::str(array.dtype()).cast<std::string>(), ": must be bool or uint8"));
  }
  CheckShape(array, name, {-1, -1}, "(height, width)");
  const py::array_t<uint8_t, py::array::c_style | py::array::forcecast> bytes(array);
  Mask mask(static_cast<int>(array.shape(1)), static_cast<int>(array.shape(0)));
  std::copy_n(bytes.data(), mask.size(), mask.data());
  return mask;
}

/// An (H, W) array of numbers.
inline DepthMap ToDepthMap(const py::handle& value, const std::string& name) {
  const Doubles numbers = Numbers(value, name);
  CheckShape(numbers, name, {-1, -1}, "(height, width)");
  DepthMap depth(static_cast<int>(numbers.shape(1)), static_cast<int>(numbers.shape(0)));
  std::transform(numbers.data(), numbers.data() + numbers.size(), depth.begin(),
                 [](double z) { return static_cast<float>(z); });
  return depth;
}

/// An (M, 3) array of numbers.
inline std::vector<Eigen::Vector3d> ToPoints(const py::handle& value, const std::string& name) {
  const Doubles numbers = Numbers(value, name);
  CheckShape(numbers, name, {-1, 3}, "(M, 3)");
  std::vector<Eigen::Vector3d> points(static_cast<size_t>(numbers.shape(0)));
  for (size_t i = 0; i < points.size(); ++i) points[i] = Eigen::Vector3d(numbers.data() + 3 * i);
  return points;
}

inline PointCloud ToCloud(const py::handle& value, const std::string& name) {
  PointCloud cloud;
  for (const Eigen::Vector3d& point : ToPoints(value, name)) {
    const Eigen::Vector3f rounded = point.cast<float>();
    cloud.push_back({{rounded.x(), rounded.y(), rounded.z()}, {}, {}, 0});
  }
  return cloud;
}

/// A 3 x 3 matrix, row by row.
inline PinholeCamera ToCamera(const double* k, const ColorImage& image, const std::string& name) {
  if (k[1] != 0 || k[3] != 0 || k[6] != 0 || k[7] != 0 || k[8] != 1) {
    throw InvalidInputError(Concat(name, " = [", k[0], " ", k[1], " ", k[2], "; ", k[3], " ", k[4], " ", k[5], "; ",
                                   k[6], " ", k[7], " ", k[8], "]: must be [fx 0 cx; 0 fy cy; 0 0 1]"));
  }
  const PinholeCamera camera = {image.width(), image.height(), k[0], k[4], k[2], k[5]};
  CheckCamera(name.c_str(), camera);
  return camera;
}

/// A 4 x 4 matrix, or its upper three rows, row by row.
inline RigidTransform ToPose(const double* values, py::ssize_t rows, const std::string& name) {
  Eigen::Matrix<double, 4, 4, Eigen::RowMajor> matrix = Eigen::Matrix4d::Identity();
  std::copy_n(values, 4 * rows, matrix.data());
  if (matrix.row(3) != Eigen::RowVector4d(0, 0, 0, 1)) {
    throw InvalidInputError(Concat(name, ": last row ", matrix.row(3), ": must be 0 0 0 1"));
  }
  RigidTransform pose;
  pose.matrix() = matrix;
  CheckPose(name.c_str(), pose);
  return pose;
}

/// None, or near and far.
inline std::optional<DepthRange> ToDepthRange(const py::handle& value, const std::string& name) {
  if (value.is_none()) return std::nullopt;
  const Doubles numbers = Numbers(value, name);
  CheckShape(numbers, name, {2}, "(near, far)");
  const DepthRange range = {static_cast<float>(numbers.at(0)), static_cast<float>(numbers.at(1))};
  CheckDepthRange(name.c_str(), range);
  return range;
}

/// "NAME=VALUE" of each item.
inline std::vector<std::string> ToAssignments(const py::dict& options) {
  std::vector<std::string> assignments;
  for (const auto& [name, value] : options) {
    std::string text = py::str(value).cast<std::string>();
    if (text == "True") text = "true";
    if (text == "False") text = "false";
    assignments.push_back(py::str(name).cast<std::string>() + "=" + text);
  }
  return assignments;
}

}  // namespace acmp::python
