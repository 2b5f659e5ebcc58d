// acmp_mapping.offline: the offline pipeline and the evaluation for Python. Conversion alone; all else is the
// library's.

#include <pybind11/numpy.h>
#include <pybind11/pybind11.h>
#include <pybind11/stl.h>

#include <algorithm>
#include <chrono>
#include <future>
#include <optional>
#include <sstream>
#include <string>
#include <utility>
#include <vector>

#include "acmp_mapping/common/error.h"
#include "acmp_mapping/dataset/map_io.h"
#include "acmp_mapping/evaluation/cloud_metrics.h"
#include "acmp_mapping/evaluation/depth_metrics.h"
#include "acmp_mapping/keyframe/landmark_visibility.h"
#include "acmp_mapping/reconstruction/reconstruct_images.h"
#include "docstrings.h"

namespace acmp::python {
namespace {

namespace py = pybind11;

// What Python hands over as the library's types. All throw InvalidInputError that begins with `name`.

std::string ShapeOf(const py::array& array) { return py::str(array.attr("shape")).cast<std::string>(); }

/// One of several: "K[3]".
std::string ElementName(const std::string& name, size_t index) { return Concat(name, "[", index, "]"); }

py::array AnyArray(const py::handle& value, const std::string& name) {
  py::array array = py::array::ensure(value);
  if (!array) throw InvalidInputError(name + ": must be an array");
  return array;
}

using Doubles = py::array_t<double, py::array::c_style | py::array::forcecast>;

/// Contiguous double precision numbers, from whatever numpy takes for such.
Doubles Numbers(const py::handle& value, const std::string& name) {
  const py::array array = AnyArray(value, name);
  const char kind = array.dtype().kind();
  if (kind != 'f' && kind != 'i' && kind != 'u') {
    throw InvalidInputError(
        Concat(name, ": dtype ", py::str(array.dtype()).cast<std::string>(), ": must be real numbers"));
  }
  return Doubles::ensure(array);
}

/// An array of this many elements along each axis; -1: any.
void CheckShape(const py::array& array, const std::string& name, const std::vector<py::ssize_t>& shape,
                const std::string& wanted) {
  bool fits = array.ndim() == static_cast<py::ssize_t>(shape.size());
  for (size_t axis = 0; fits && axis < shape.size(); ++axis) {
    fits = shape[axis] < 0 || array.shape(static_cast<py::ssize_t>(axis)) == shape[axis];
  }
  if (!fits) throw InvalidInputError(Concat(name, ": shape ", ShapeOf(array), ": must be ", wanted));
}

/// The elements of a list or array.
std::vector<py::object> Elements(const py::handle& value, const std::string& name) {
  if (!py::isinstance<py::sequence>(value) && !py::isinstance<py::array>(value)) {
    throw InvalidInputError(name + ": must be a sequence");
  }
  std::vector<py::object> elements;
  for (const py::handle& element : value) elements.push_back(py::reinterpret_borrow<py::object>(element));
  return elements;
}

/// An element for each image.
std::vector<py::object> PerImage(const py::handle& value, const std::string& name, size_t images) {
  std::vector<py::object> elements = Elements(value, name);
  if (elements.size() == images) return elements;
  throw InvalidInputError(
      Concat(name, ": has ", elements.size(), " elements: must be one for each of ", images, " images"));
}

/// An (H, W) array of bytes or an (H, W, 3) one, with any strides.
ColorImage ToColorImage(const py::handle& value, const std::string& name, bool is_bgr) {
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
Mask ToMask(const py::handle& value, const std::string& name) {
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
DepthMap ToDepthMap(const py::handle& value, const std::string& name) {
  const Doubles numbers = Numbers(value, name);
  CheckShape(numbers, name, {-1, -1}, "(height, width)");
  DepthMap depth(static_cast<int>(numbers.shape(1)), static_cast<int>(numbers.shape(0)));
  std::transform(numbers.data(), numbers.data() + numbers.size(), depth.begin(),
                 [](double z) { return static_cast<float>(z); });
  return depth;
}

/// An (M, 3) array of numbers.
std::vector<Eigen::Vector3d> ToPoints(const py::handle& value, const std::string& name) {
  const Doubles numbers = Numbers(value, name);
  CheckShape(numbers, name, {-1, 3}, "(M, 3)");
  std::vector<Eigen::Vector3d> points(static_cast<size_t>(numbers.shape(0)));
  for (size_t i = 0; i < points.size(); ++i) points[i] = Eigen::Vector3d(numbers.data() + 3 * i);
  return points;
}

PointCloud ToCloud(const py::handle& value, const std::string& name, ReadOrigin* origin) {
  PointCloud cloud;
  for (const Eigen::Vector3d& point : ToPoints(value, name)) cloud.push_back({FromOrigin(point, origin), {}, {}, 0});
  return cloud;
}

/// A 3 x 3 matrix, row by row.
PinholeCamera ToCamera(const double* k, const ColorImage& image, const std::string& name) {
  if (k[1] != 0 || k[3] != 0 || k[6] != 0 || k[7] != 0 || k[8] != 1) {
    throw InvalidInputError(Concat(name, " = [", k[0], " ", k[1], " ", k[2], "; ", k[3], " ", k[4], " ", k[5], "; ",
                                   k[6], " ", k[7], " ", k[8], "]: must be [fx 0 cx; 0 fy cy; 0 0 1]"));
  }
  const PinholeCamera camera = {image.width(), image.height(), k[0], k[4], k[2], k[5]};
  CheckCamera(name.c_str(), camera);
  return camera;
}

/// A 4 x 4 matrix, or its upper three rows, row by row.
RigidTransform ToPose(const double* values, py::ssize_t rows, const std::string& name) {
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
std::optional<DepthRange> ToDepthRange(const py::handle& value, const std::string& name) {
  if (value.is_none()) return std::nullopt;
  const Doubles numbers = Numbers(value, name);
  CheckShape(numbers, name, {2}, "(near, far)");
  const DepthRange range = {static_cast<float>(numbers.at(0)), static_cast<float>(numbers.at(1))};
  CheckDepthRange(name.c_str(), range);
  return range;
}

/// "NAME=VALUE" of each item.
std::vector<std::string> ToAssignments(const py::dict& options) {
  std::vector<std::string> assignments;
  for (const auto& [name, value] : options) {
    std::string text = py::str(value).cast<std::string>();
    if (text == "True") text = "true";
    if (text == "False") text = "false";
    assignments.push_back(py::str(name).cast<std::string>() + "=" + text);
  }
  return assignments;
}

/// Runs `work` in a thread of its own without Python's lock, so that other Python threads go on, and throws what it
/// throws. Meanwhile Python's signal handlers run: where one raises (Ctrl-C: KeyboardInterrupt, in the main thread) the
/// work is stopped and that is thrown.
/// @param work takes a StopRequest*; must not touch Python
template <class Work>
void RunInterruptibly(const Work& work) {
  const py::gil_scoped_release release;
  StopRequest stop;
  std::future<void> done = std::async(std::launch::async, [&] {
    stop.RunCancellable([&] { work(&stop); });
    stop.Check();
  });
  constexpr std::chrono::milliseconds kTimeToReact(50);
  while (done.wait_for(kTimeToReact) != std::future_status::ready) {
    const py::gil_scoped_acquire acquire;
    if (PyErr_CheckSignals() == 0) continue;
    stop.Request();
    const py::error_already_set raised;
    {
      const py::gil_scoped_release while_waiting;
      done.wait();
    }
    throw raised;
  }
  done.get();
}

/// The pixels without a copy: the array owns them.
template <class T, class Pixel>
py::array ToNumpy(Image<Pixel> image) {
  std::vector<py::ssize_t> shape = {image.height(), image.width()};
  if (sizeof(Pixel) > sizeof(T)) shape.push_back(sizeof(Pixel) / sizeof(T));
  auto* owned = new Image<Pixel>(std::move(image));
  const py::capsule owner(owned, [](void* pixels) { delete static_cast<Image<Pixel>*>(pixels); });
  return py::array_t<T>(std::move(shape), reinterpret_cast<const T*>(owned->data()), owner);
}

template <int kSize>
py::array ToNumpy(const Eigen::Matrix<double, kSize, kSize>& matrix) {
  py::array_t<double> array({kSize, kSize});
  Eigen::Map<Eigen::Matrix<double, kSize, kSize, Eigen::RowMajor>>(array.mutable_data()) = matrix;
  return array;
}

/// Of the points in a cloud: (M, 3) arrays and one of (M,).
struct Cloud {
  Cloud(const PointCloud& cloud, const Eigen::Vector3d& origin)
      : points(origin.isZero(0) ? py::array(Positions<float>(cloud, origin)) : Positions<double>(cloud, origin)),
        normals({cloud.size(), size_t{3}}),
        colors({cloud.size(), size_t{3}}),
        confidence(static_cast<py::ssize_t>(cloud.size())) {
    for (size_t i = 0; i < cloud.size(); ++i) {
      const SurfacePoint& point = cloud[i];
      std::copy_n(&point.normal.x, 3, normals.mutable_data() + 3 * i);
      std::copy_n(&point.color.r, 3, colors.mutable_data() + 3 * i);
      confidence.mutable_data()[i] = point.confidence;
    }
  }

  template <class T>
  static py::array_t<T> Positions(const PointCloud& cloud, const Eigen::Vector3d& origin) {
    py::array_t<T> positions({cloud.size(), size_t{3}});
    T* target = positions.mutable_data();
    for (const SurfacePoint& point : cloud) {
      const Eigen::Vector3d position = InWorld(origin, point.position);
      target = std::transform(position.data(), position.data() + 3, target, [](double v) { return static_cast<T>(v); });
    }
    return positions;
  }

  py::array points;  ///< float64 where float32 would not hold them
  py::array_t<float> normals;
  py::array_t<uint8_t> colors;
  py::array_t<float> confidence;
};

struct PythonImageResult {
  std::string name;
  py::object depth = py::none(), normal = py::none(), cost = py::none(), confidence = py::none();
  py::array K, cam_from_world;
  std::vector<int> source_views;
  std::string no_map;
};

struct PythonReconstruction {
  std::vector<PythonImageResult> images;
  Cloud cloud;
  std::string device;
};

PythonImageResult ToPython(std::string name, const RigidTransform& cam_from_world, ImageResult result) {
  PythonImageResult image;
  image.name = std::move(name);
  if (result.no_map.empty()) {
    image.depth = ToNumpy<float>(std::move(result.depth));
    image.normal = ToNumpy<float>(std::move(result.normal));
    image.cost = ToNumpy<float>(std::move(result.cost));
    image.confidence = ToNumpy<float>(std::move(result.confidence));
  }
  image.K = ToNumpy(result.camera.K());
  image.cam_from_world = ToNumpy(cam_from_world.matrix());
  image.source_views = std::move(result.sources);
  image.no_map = std::move(result.no_map);
  return image;
}

void ReadCameras(const py::object& k, std::vector<InputImage>* images) {
  const Doubles numbers = Numbers(k, "K");
  const bool is_shared = numbers.ndim() == 2;
  const auto count = static_cast<py::ssize_t>(images->size());
  const std::string wanted = Concat("(3, 3), or (", count, ", 3, 3) for ", count, " images");
  CheckShape(numbers, "K", is_shared ? std::vector<py::ssize_t>{3, 3} : std::vector<py::ssize_t>{count, 3, 3}, wanted);
  for (size_t i = 0; i < images->size(); ++i) {
    InputImage& image = (*images)[i];
    image.camera =
        ToCamera(numbers.data() + (is_shared ? 0 : 9 * i), image.color, is_shared ? "K" : ElementName("K", i));
  }
}

void ReadPoses(const py::object& cam_from_world, const py::object& world_from_cam, std::vector<InputImage>* images) {
  if (cam_from_world.is_none() == world_from_cam.is_none()) {
    throw InvalidInputError("poses: give either cam_from_world or world_from_cam");
  }
  const bool inverse = cam_from_world.is_none();
  const char* name = inverse ? "world_from_cam" : "cam_from_world";
  const Doubles numbers = Numbers(inverse ? world_from_cam : cam_from_world, name);
  const auto count = static_cast<py::ssize_t>(images->size());
  const py::ssize_t rows = numbers.ndim() == 3 && numbers.shape(1) == 3 ? 3 : 4;
  CheckShape(numbers, name, {count, rows, 4},
             Concat("(", count, ", 4, 4) or (", count, ", 3, 4) for ", count, " images"));
  for (size_t i = 0; i < images->size(); ++i) {
    const RigidTransform pose = ToPose(numbers.data() + 4 * rows * i, rows, ElementName(name, i));
    (*images)[i].cam_from_world = inverse ? pose.inverse() : pose;
  }
}

void ReadDepthRanges(const py::object& value, std::vector<InputImage>* images) {
  if (value.is_none()) return;
  const std::vector<py::object> elements = Elements(value, "depth_range");
  const bool is_shared =
      elements.size() == 2 && !elements[0].is_none() && AnyArray(elements[0], "depth_range").ndim() == 0;
  const std::vector<py::object> each =
      is_shared ? std::vector<py::object>() : PerImage(value, "depth_range", images->size());
  for (size_t i = 0; i < images->size(); ++i) {
    (*images)[i].depth_range =
        is_shared ? ToDepthRange(value, "depth_range") : ToDepthRange(each[i], ElementName("depth_range", i));
  }
}

/// After cameras and poses.
void ReadLandmarks(const py::object& value, std::vector<InputImage>* images) {
  if (value.is_none()) return;
  if (py::isinstance<py::array>(value) && AnyArray(value, "points").ndim() == 2) {
    const std::vector<Eigen::Vector3d> all = ToPoints(value, "points");
    for (InputImage& image : *images) {
      image.landmarks_in_world = FindLandmarksInView(all, image.camera, image.cam_from_world).points_in_world;
    }
    return;
  }
  const std::vector<py::object> each = PerImage(value, "points", images->size());
  for (size_t i = 0; i < images->size(); ++i) {
    (*images)[i].landmarks_in_world = ToPoints(each[i], ElementName("points", i));
  }
}

void ReadMasks(const py::object& value, std::vector<InputImage>* images) {
  if (value.is_none()) return;
  const std::vector<py::object> each = PerImage(value, "masks", images->size());
  for (size_t i = 0; i < images->size(); ++i) {
    if (!each[i].is_none()) (*images)[i].mask = ToMask(each[i], ElementName("masks", i));
  }
}

template <class T, class Field>
void ReadList(const std::optional<std::vector<T>>& values, const char* name, std::vector<InputImage>* images,
              Field InputImage::*field) {
  if (!values) return;
  if (values->size() != images->size()) {
    throw InvalidInputError(
        Concat(name, ": has ", values->size(), " elements: must be one for each of ", images->size(), " images"));
  }
  for (size_t i = 0; i < images->size(); ++i) (*images)[i].*field = (*values)[i];
}

std::vector<InputImage> ReadColors(const py::object& value, const std::string& color_order) {
  if (color_order != "rgb" && color_order != "bgr") {
    throw InvalidInputError("color_order = " + color_order + ": must be rgb or bgr");
  }
  std::vector<InputImage> images;
  for (const py::object& element : Elements(value, "images")) {
    InputImage& image = images.emplace_back();
    image.name = std::to_string(images.size() - 1);
    image.color = ToColorImage(element, ElementName("images", images.size() - 1), color_order == "bgr");
  }
  if (images.empty()) throw InvalidInputError("images: there are none");
  return images;
}

void WarnOf(const std::vector<std::string>& warnings) {
  for (const std::string& warning : warnings) {
    if (PyErr_WarnEx(PyExc_UserWarning, warning.c_str(), 1) != 0) throw py::error_already_set();
  }
}

PythonReconstruction Run(std::vector<InputImage> images, const ReconstructOptions& options) {
  std::vector<std::string> names;
  std::vector<RigidTransform> poses;
  for (const InputImage& image : images) {
    names.push_back(image.name);
    poses.push_back(image.cam_from_world);
  }
  ImageReconstruction result;
  std::ostringstream log;
  RunInterruptibly([&](StopRequest* stop) {
    result = ReconstructImages(
        std::move(images), options, [&] { return MakeDevices(options, &log); }, stop);
  });
  PythonReconstruction reconstruction = {{}, Cloud(result.cloud, result.origin), std::move(result.device)};
  WarnOf(result.warnings);
  for (size_t i = 0; i < names.size(); ++i) {
    reconstruction.images.push_back(ToPython(std::move(names[i]), poses[i], std::move(result.images[i])));
  }
  return reconstruction;
}

py::dict ReadScene(const std::string& folder, const std::string& format, const std::string& pixel_centers,
                   const std::string& masks) {
  ReconstructOptions options;
  options.scene = folder;
  options.format = format;
  options.pixel_centers = pixel_centers;
  options.masks = masks;
  std::vector<InputImage> images;
  std::vector<std::string> warnings;
  RunInterruptibly([&](StopRequest* stop) { images = ReadInputImages(options, *stop, &warnings); });
  WarnOf(warnings);
  py::list colors, all_masks, points, ranges, ranked, names, cameras, poses;
  for (InputImage& image : images) {
    colors.append(ToNumpy<uint8_t>(std::move(image.color)));
    all_masks.append(image.mask.empty() ? py::object(py::none()) : ToNumpy<uint8_t>(std::move(image.mask)));
    py::array_t<double> landmarks({image.landmarks_in_world.size(), size_t{3}});
    for (size_t i = 0; i < image.landmarks_in_world.size(); ++i) {
      std::copy_n(image.landmarks_in_world[i].data(), 3, landmarks.mutable_data() + 3 * i);
    }
    points.append(landmarks);
    ranges.append(image.depth_range ? py::object(py::make_tuple(image.depth_range->min, image.depth_range->max))
                                    : py::object(py::none()));
    ranked.append(py::cast(image.ranked_sources));
    names.append(image.name);
    cameras.append(ToNumpy(image.camera.K()));
    poses.append(ToNumpy(image.cam_from_world.matrix()));
  }
  const py::object stack = py::module_::import("numpy").attr("stack");
  using py::literals::operator""_a;
  return py::dict("images"_a = colors, "K"_a = stack(cameras), "cam_from_world"_a = stack(poses), "points"_a = points,
                  "depth_range"_a = ranges, "masks"_a = all_masks, "ranked_sources"_a = ranked, "names"_a = names);
}

py::dict EvaluateDepthMap(const py::object& depth, const py::object& truth, const py::object& mask) {
  const DepthMap estimate = ToDepthMap(depth, "depth"), true_depth = ToDepthMap(truth, "truth");
  const Mask region = mask.is_none() ? Mask() : ToMask(mask, "mask");
  DepthMetrics metrics;
  RunInterruptibly([&](StopRequest*) { metrics = EvaluateDepth(estimate, true_depth, region); });
  py::dict absolute, relative;
  for (size_t i = 0; i < kAbsoluteThresholds.size(); ++i) {
    absolute[py::float_(kAbsoluteThresholds[i])] = metrics.below_absolute[i];
    relative[py::float_(kRelativeThresholds[i])] = metrics.below_relative[i];
  }
  using py::literals::operator""_a;
  return py::dict("pixels"_a = metrics.ground_truth_pixels, "density"_a = metrics.density,
                  "median_error"_a = metrics.median_error, "below_absolute"_a = absolute,
                  "below_relative"_a = relative);
}

py::list EvaluatePoints(const py::object& points, const py::object& truth, const std::vector<double>& thresholds,
                        double voxel_size) {
  ReadOrigin origin;
  const PointCloud cloud = ToCloud(points, "points", &origin), true_cloud = ToCloud(truth, "truth", &origin);
  std::vector<CloudMetrics> all;
  RunInterruptibly([&](StopRequest*) { all = EvaluateCloud(cloud, true_cloud, thresholds, voxel_size); });
  py::list list;
  using py::literals::operator""_a;
  for (const CloudMetrics& metrics : all) {
    list.append(py::dict("threshold"_a = metrics.threshold, "accuracy"_a = metrics.accuracy,
                         "completeness"_a = metrics.completeness, "f1"_a = metrics.f1));
  }
  return list;
}

PythonReconstruction ReconstructArrays(const py::object& images, const py::object& k, const py::object& cam_from_world,
                                       const py::object& world_from_cam, const py::object& depth_range,
                                       const py::object& points, const py::object& masks,
                                       const std::optional<std::vector<std::vector<int>>>& ranked_sources,
                                       const std::optional<std::vector<std::string>>& names,
                                       const std::string& color_order, const std::string& preset,
                                       const py::dict& options, int source_views, int max_image_size, uint32_t seed,
                                       const std::string& device) {
  std::vector<InputImage> input = ReadColors(images, color_order);
  ReadCameras(k, &input);
  ReadPoses(cam_from_world, world_from_cam, &input);
  ReadDepthRanges(depth_range, &input);
  ReadLandmarks(points, &input);
  ReadMasks(masks, &input);
  ReadList(ranked_sources, "ranked_sources", &input, &InputImage::ranked_sources);
  ReadList(names, "names", &input, &InputImage::name);
  ReconstructOptions all;
  all.preset = preset;
  all.set = ToAssignments(options);
  CheckRange("source_views", source_views, 1, kMaxSelectedViews);
  all.source_views = source_views;
  CheckRange("max_image_size", max_image_size, 0, 65536);
  all.max_image_size = max_image_size;
  all.seed = seed;
  all.device = device;
  return Run(std::move(input), all);
}

void DefineResults(py::module_* module) {
  py::class_<Cloud>(*module, "Cloud", kCloudDoc)
      .def_readonly("points", &Cloud::points)
      .def_readonly("normals", &Cloud::normals)
      .def_readonly("colors", &Cloud::colors)
      .def_readonly("confidence", &Cloud::confidence);
  py::class_<PythonImageResult>(*module, "ImageResult", kImageResultDoc)
      .def_readonly("name", &PythonImageResult::name)
      .def_readonly("depth", &PythonImageResult::depth)
      .def_readonly("normal", &PythonImageResult::normal)
      .def_readonly("cost", &PythonImageResult::cost)
      .def_readonly("confidence", &PythonImageResult::confidence)
      .def_readonly("K", &PythonImageResult::K)
      .def_readonly("cam_from_world", &PythonImageResult::cam_from_world)
      .def_readonly("source_views", &PythonImageResult::source_views)
      .def_readonly("no_map", &PythonImageResult::no_map);
  py::class_<PythonReconstruction>(*module, "Reconstruction", kReconstructionDoc)
      .def_readonly("images", &PythonReconstruction::images)
      .def_readonly("cloud", &PythonReconstruction::cloud)
      .def_readonly("device", &PythonReconstruction::device);
}

/// The tool's words for arguments as Python's.
std::string InPythonsWords(std::string message) {
  const std::string option = "--depth-min and --depth-max";
  const size_t at = message.find(option);
  if (at != std::string::npos) message.replace(at, option.size(), "depth_range=, or points=");
  return message;
}

/// A docstring from which inspect.signature and editors know the arguments.
std::string WithSignature(const std::string& signature, const char* doc) { return signature + "\n--\n\n" + doc; }

void Define(py::module_* module) {
  module->doc() = kModuleDoc;
  py::register_exception_translator([](std::exception_ptr thrown) {
    try {
      if (thrown) std::rethrow_exception(thrown);
    } catch (const InvalidInputError& error) {
      PyErr_SetString(PyExc_ValueError, InPythonsWords(error.what()).c_str());
    } catch (const ProcessingError& error) {
      PyErr_SetString(PyExc_RuntimeError, error.what());
    }
  });
  DefineResults(module);
  using py::literals::operator""_a;
  const ReconstructOptions defaults;
  py::options docstrings;
  docstrings.disable_function_signatures();  // ours are those that Python can parse
  const std::string reconstruct_doc = WithSignature(
      Concat("reconstruct(images, K, *, cam_from_world=None, world_from_cam=None, depth_range=None, points=None, "
             "masks=None, ranked_sources=None, names=None, color_order='rgb', preset='",
             defaults.preset, "', options={}, source_views=", defaults.source_views, ", max_image_size=",
             defaults.max_image_size, ", seed=", defaults.seed, ", device='", defaults.device, "')"),
      kReconstructDoc);
  module->def("reconstruct", &ReconstructArrays, reconstruct_doc.c_str(), "images"_a, "K"_a, py::kw_only(),
              "cam_from_world"_a = py::none(), "world_from_cam"_a = py::none(), "depth_range"_a = py::none(),
              "points"_a = py::none(), "masks"_a = py::none(), "ranked_sources"_a = py::none(), "names"_a = py::none(),
              "color_order"_a = "rgb", "preset"_a = defaults.preset, "options"_a = py::dict(),
              "source_views"_a = defaults.source_views, "max_image_size"_a = defaults.max_image_size,
              "seed"_a = defaults.seed, "device"_a = defaults.device);
  const std::string read_scene_doc = WithSignature(Concat("read_scene(folder, *, format='", defaults.format,
                                                          "', pixel_centers='", defaults.pixel_centers, "', masks='')"),
                                                   kReadSceneDoc);
  module->def("read_scene", &ReadScene, read_scene_doc.c_str(), "folder"_a, py::kw_only(), "format"_a = defaults.format,
              "pixel_centers"_a = defaults.pixel_centers, "masks"_a = "");
  module->def("evaluate_depth", &EvaluateDepthMap,
              WithSignature("evaluate_depth(depth, truth, mask=None)", kEvaluateDepthDoc).c_str(), "depth"_a, "truth"_a,
              "mask"_a = py::none());
  module->def(
      "evaluate_cloud", &EvaluatePoints,
      WithSignature("evaluate_cloud(points, truth, thresholds=[0.02, 0.05], voxel_size=0.01)", kEvaluateCloudDoc)
          .c_str(),
      "points"_a, "truth"_a, "thresholds"_a = std::vector<double>{0.02, 0.05}, "voxel_size"_a = 0.01);
}

}  // namespace
}  // namespace acmp::python

PYBIND11_MODULE(offline, module) { acmp::python::Define(&module); }
