// acmp_mapping._offline: the offline pipeline and the evaluation, on what offline.py has looked through. Conversion
// alone; all else is the library's.

#include <pybind11/numpy.h>
#include <pybind11/pybind11.h>
#include <pybind11/stl.h>

#include <algorithm>
#include <cctype>
#include <chrono>
#include <cmath>
#include <cstring>
#include <future>
#include <optional>
#include <sstream>
#include <string>
#include <utility>
#include <vector>

#include "acmp_mapping/common/error.h"
#include "acmp_mapping/dataset/image_codec.h"
#include "acmp_mapping/dataset/map_io.h"
#include "acmp_mapping/dataset/raw_image.h"
#include "acmp_mapping/evaluation/cloud_metrics.h"
#include "acmp_mapping/evaluation/depth_metrics.h"
#include "acmp_mapping/keyframe/landmark_visibility.h"
#include "acmp_mapping/reconstruction/reconstruct.h"

namespace acmp::python {
namespace {

namespace py = pybind11;
using py::literals::operator""_a;

using Bytes = py::array_t<uint8_t, py::array::c_style | py::array::forcecast>;
using Doubles = py::array_t<double, py::array::c_style | py::array::forcecast>;

/// An (H, W, 3) array, red first.
ColorImage ToColorImage(const Bytes& array) {
  ColorImage image(static_cast<int>(array.shape(1)), static_cast<int>(array.shape(0)));
  std::copy_n(array.data(), array.size(), reinterpret_cast<uint8_t*>(image.data()));
  return image;
}

/// An (H, W) array.
template <class T, class Array>
Image<T> ToMap(const Array& array) {
  Image<T> map(static_cast<int>(array.shape(1)), static_cast<int>(array.shape(0)));
  std::transform(array.data(), array.data() + array.size(), map.begin(), [](auto v) { return static_cast<T>(v); });
  return map;
}

Mask ToMask(const std::optional<Bytes>& array) { return array ? ToMap<unsigned char>(*array) : Mask(); }

/// z; 0 where it is not positive and finite.
DepthMap ToPriorDepth(const Doubles& array, const std::string& name) {
  DepthMap depth = ToMap<float>(array);
  bool has_depth = false;
  for (float& z : depth) {
    if (!(z > 0 && std::isfinite(z))) z = 0;
    has_depth = has_depth || z > 0;
  }
  if (!has_depth) throw InvalidInputError(name + ": no pixel has a positive, finite depth");
  return depth;
}

/// An (M, 3) array.
std::vector<Eigen::Vector3d> ToPoints(const Doubles& array) {
  std::vector<Eigen::Vector3d> points(static_cast<size_t>(array.shape(0)));
  for (size_t i = 0; i < points.size(); ++i) points[i] = Eigen::Vector3d(array.data() + 3 * i);
  return points;
}

PointCloud ToCloud(const Doubles& array, ReadOrigin* origin) {
  PointCloud cloud;
  for (const Eigen::Vector3d& point : ToPoints(array)) cloud.push_back({FromOrigin(point, origin), {}, {}, 0});
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

template <class T>
py::array_t<T> Positions(const PointCloud& cloud, const Eigen::Vector3d& origin) {
  py::array_t<T> positions({cloud.size(), size_t{3}});
  T* target = positions.mutable_data();
  for (const SurfacePoint& point : cloud) {
    const Eigen::Vector3d position = InWorld(origin, point.position);
    target = std::transform(position.data(), position.data() + 3, target, [](double v) { return static_cast<T>(v); });
  }
  return positions;
}

/// Positions, in double where float would not hold them, normals, colours: (M, 3); confidence: (M,).
py::tuple ToPython(const PointCloud& cloud, const Eigen::Vector3d& origin) {
  py::array_t<float> normals({cloud.size(), size_t{3}}), confidence(static_cast<py::ssize_t>(cloud.size()));
  py::array_t<uint8_t> colors({cloud.size(), size_t{3}});
  for (size_t i = 0; i < cloud.size(); ++i) {
    std::copy_n(&cloud[i].normal.x, 3, normals.mutable_data() + 3 * i);
    std::copy_n(&cloud[i].color.r, 3, colors.mutable_data() + 3 * i);
    confidence.mutable_data()[i] = cloud[i].confidence;
  }
  return py::make_tuple(
      origin.isZero(0) ? py::array(Positions<float>(cloud, origin)) : Positions<double>(cloud, origin), normals, colors,
      confidence);
}

/// The fields of an ImageResult.
py::tuple ToPython(const std::string& name, const RigidTransform& cam_from_world, ImageResult image) {
  const bool has_map = image.no_map.empty();
  const auto map = [has_map](auto pixels) {
    return has_map ? py::object(ToNumpy<float>(std::move(pixels))) : py::object(py::none());
  };
  return py::make_tuple(name, map(std::move(image.maps.depth)), map(std::move(image.maps.normal)),
                        map(std::move(image.maps.cost)), map(std::move(image.maps.confidence)),
                        ToNumpy(image.camera.K()), ToNumpy(cam_from_world.matrix()), image.sources, image.no_map);
}

/// The tool's words for arguments as Python's: "--max-image-size" is "max_image_size=".
std::string InPythonsWords(std::string message) {
  const std::pair<const char*, const char*> others[] = {{"--depth-min and --depth-max", "depth_range=, or points="},
                                                        {"--set completion=true", "options={'completion': True}"},
                                                        {"--set", "options="}};
  for (const auto& [words, by] : others) {
    for (size_t at; (at = message.find(words)) != std::string::npos;) message.replace(at, std::strlen(words), by);
  }
  const auto is_letter = [&](size_t at) {
    return at < message.size() && std::islower(static_cast<unsigned char>(message[at])) != 0;
  };
  for (size_t at = 0; (at = message.find("--", at)) != std::string::npos; ++at) {
    if (!is_letter(at + 2) || (at > 0 && std::isalnum(static_cast<unsigned char>(message[at - 1])) != 0)) continue;
    message.erase(at, 2);
    size_t end = at;
    for (; is_letter(end) || (end < message.size() && message[end] == '-'); ++end) {
      if (message[end] == '-') message[end] = '_';
    }
    message.insert(end, "=");
  }
  return message;
}

void WarnOf(const std::vector<std::string>& warnings) {
  for (const std::string& warning : warnings) {
    if (PyErr_WarnEx(PyExc_UserWarning, InPythonsWords(warning).c_str(), 1) != 0) throw py::error_already_set();
  }
}

/// @param pose_name cam_from_world, or world_from_cam for its inverse
/// @param points one array for all images, of which each gets what it sees, or one or nothing for each
/// @return the results of the images, the cloud, the device
py::tuple ReconstructArrays(const std::vector<Bytes>& colors, const Doubles& k, const Doubles& poses,
                            const std::string& pose_name,
                            const std::vector<std::optional<std::pair<double, double>>>& ranges, bool points_in_all,
                            const std::vector<std::optional<Doubles>>& points,
                            const std::vector<std::optional<Bytes>>& masks,
                            const std::vector<std::optional<Doubles>>& prior_depths,
                            const std::vector<std::vector<int>>& ranked_sources, const std::vector<std::string>& names,
                            const std::string& preset, const std::vector<std::string>& set, int source_views,
                            int max_image_size, uint32_t seed, const std::string& device) {
  std::vector<InputImage> images(colors.size());
  std::vector<RigidTransform> cam_from_world;
  const std::vector<Eigen::Vector3d> points_of_all =
      points_in_all ? ToPoints(*points[0]) : std::vector<Eigen::Vector3d>();
  for (size_t i = 0; i < images.size(); ++i) {
    InputImage& image = images[i];
    image.name = names[i];
    image.color = ToColorImage(colors[i]);
    image.camera = ToCamera(k.data() + 9 * i, image.color, Concat("K[", i, "]"));
    const py::ssize_t rows = poses.shape(1);
    const RigidTransform pose = ToPose(poses.data() + 4 * rows * i, rows, Concat(pose_name, "[", i, "]"));
    image.cam_from_world = pose_name == "cam_from_world" ? pose : pose.inverse();
    cam_from_world.push_back(image.cam_from_world);
    if (ranges[i]) {
      image.depth_range = {static_cast<float>(ranges[i]->first), static_cast<float>(ranges[i]->second)};
      CheckDepthRange(Concat("depth_range[", i, "]").c_str(), *image.depth_range);
    }
    image.mask = ToMask(masks[i]);
    if (prior_depths[i]) image.prior_depth = ToPriorDepth(*prior_depths[i], Concat("prior_depth[", i, "]"));
    image.ranked_sources = ranked_sources[i];
    if (points_in_all) {
      const py::gil_scoped_release release;
      image.landmarks_in_world = FindLandmarksInView(points_of_all, image.camera, image.cam_from_world).points_in_world;
    } else if (points[i]) {
      image.landmarks_in_world = ToPoints(*points[i]);
    }
  }
  ReconstructOptions options;
  options.preset = preset;
  options.set = set;
  CheckRange("source_views", source_views, 1, kMaxSelectedViews);
  options.source_views = source_views;
  CheckRange("max_image_size", max_image_size, 0, 65536);
  options.max_image_size = max_image_size;
  options.seed = seed;
  options.device = device;
  ImageReconstruction result;
  std::ostringstream log;
  RunInterruptibly([&](StopRequest* stop) {
    result = ReconstructImages(
        std::move(images), options, [&] { return MakeDevices(options, &log); }, stop);
  });
  WarnOf(result.warnings);
  py::list results;
  for (size_t i = 0; i < names.size(); ++i) {
    results.append(ToPython(names[i], cam_from_world[i], std::move(result.images[i])));
  }
  return py::make_tuple(results, ToPython(result.cloud, result.origin), result.device);
}

py::dict ReadScene(const std::string& folder, const std::string& format, const std::string& pixel_centers,
                   const std::string& masks, const std::string& prior_depth, const std::string& image_path) {
  ReconstructOptions options;
  options.scene = folder;
  options.format = format;
  options.pixel_centers = pixel_centers;
  options.masks = masks;
  options.prior_depth = prior_depth;
  options.image_path = image_path;
  std::vector<InputImage> images;
  std::vector<std::string> warnings;
  RunInterruptibly([&](StopRequest* stop) { images = ReadInputImages(options, *stop, &warnings); });
  WarnOf(warnings);
  py::list colors, all_masks, prior_depths, points, ranges, ranked, names, cameras, poses;
  for (InputImage& image : images) {
    colors.append(ToNumpy<uint8_t>(std::move(image.color)));
    all_masks.append(image.mask.empty() ? py::object(py::none()) : ToNumpy<uint8_t>(std::move(image.mask)));
    prior_depths.append(image.prior_depth.empty() ? py::object(py::none())
                                                  : ToNumpy<float>(std::move(image.prior_depth)));
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
  return py::dict("images"_a = colors, "K"_a = cameras, "cam_from_world"_a = poses, "points"_a = points,
                  "depth_range"_a = ranges, "masks"_a = all_masks, "prior_depth"_a = prior_depths,
                  "ranked_sources"_a = ranked, "names"_a = names);
}

/// RGB of a picture's content: (height, width, 3). @param size that its header must say: width, height
py::array DecodeImage(const std::string& name, const py::bytes& content, const std::optional<std::pair<int, int>>& size,
                      uint64_t max_pixels) {
  const std::string bytes = content;
  ColorImage image;
  {
    const py::gil_scoped_release release;
    const ImageSize found = EncodedImageSize(name, bytes);
    if (size && (found.width != size->first || found.height != size->second)) {
      throw InvalidInputError(Concat(name, ": its header says ", found.width, " x ", found.height, " px: must be ",
                                     size->first, " x ", size->second));
    }
    if (static_cast<uint64_t>(found.width) * static_cast<uint64_t>(found.height) > max_pixels) {
      throw InvalidInputError(
          Concat(name, ": its header says ", found.width, " x ", found.height, " px: at most ", max_pixels));
    }
    image = DecodeColorImage(name, bytes);
  }
  return ToNumpy<uint8_t>(std::move(image));
}

/// RGB of a raw image's bytes: (height, width, 3).
py::array DecodeRaw(RawImageDecoder* decoder, const std::string& encoding, uint32_t width, uint32_t height,
                    uint32_t step, bool big_endian, const py::bytes& data) {
  const std::string bytes = data;
  const cv::Mat rgb = decoder->Decode({encoding, width, height, step, big_endian, bytes});
  return py::array_t<uint8_t>({rgb.rows, rgb.cols, rgb.channels()}, rgb.data);
}

py::dict EvaluateDepthMap(const Doubles& depth, const Doubles& truth, const std::optional<Bytes>& mask) {
  const DepthMap estimate = ToMap<float>(depth), true_depth = ToMap<float>(truth);
  const Mask region = ToMask(mask);
  DepthMetrics metrics;
  RunInterruptibly([&](StopRequest*) { metrics = EvaluateDepth(estimate, true_depth, region); });
  py::dict absolute, relative;
  for (size_t i = 0; i < kAbsoluteThresholds.size(); ++i) {
    absolute[py::float_(kAbsoluteThresholds[i])] = metrics.below_absolute[i];
    relative[py::float_(kRelativeThresholds[i])] = metrics.below_relative[i];
  }
  return py::dict("pixels"_a = metrics.ground_truth_pixels, "density"_a = metrics.density,
                  "median_error"_a = metrics.median_error, "below_absolute"_a = absolute,
                  "below_relative"_a = relative);
}

py::list EvaluatePoints(const Doubles& points, const Doubles& truth, const std::vector<double>& thresholds,
                        double voxel_size) {
  ReadOrigin origin;
  const PointCloud cloud = ToCloud(points, &origin), true_cloud = ToCloud(truth, &origin);
  std::vector<CloudMetrics> all;
  RunInterruptibly([&](StopRequest*) { all = EvaluateCloud(cloud, true_cloud, thresholds, voxel_size); });
  py::list list;
  for (const CloudMetrics& metrics : all) {
    list.append(py::dict("threshold"_a = metrics.threshold, "accuracy"_a = metrics.accuracy,
                         "completeness"_a = metrics.completeness, "f1"_a = metrics.f1));
  }
  return list;
}

}  // namespace
}  // namespace acmp::python

PYBIND11_MODULE(_offline, module) {
  using namespace acmp::python;  // NOLINT(google-build-using-namespace)
  py::register_exception_translator([](std::exception_ptr thrown) {
    try {
      if (thrown) std::rethrow_exception(thrown);
    } catch (const acmp::InvalidInputError& error) {
      PyErr_SetString(PyExc_ValueError, InPythonsWords(error.what()).c_str());
    } catch (const acmp::ProcessingError& error) {
      PyErr_SetString(PyExc_RuntimeError, error.what());
    }
  });
  module.def("reconstruct", &ReconstructArrays);
  module.def("read_scene", &ReadScene);
  module.def("decode_image", &DecodeImage);
  py::class_<acmp::RawImageDecoder>(module, "RawImageDecoder").def(py::init<>()).def("decode", &DecodeRaw);
  module.def("evaluate_depth", &EvaluateDepthMap);
  module.def("evaluate_cloud", &EvaluatePoints);
}
