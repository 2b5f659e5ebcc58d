#include <algorithm>
#include <chrono>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <future>
#include <iomanip>
#include <iostream>
#include <random>
#include <string>

#include <unistd.h>
#include <CLI/CLI.hpp>

#include "acmp_mapping/common/error.h"
#include "acmp_mapping/common/memory_limit.h"
#include "acmp_mapping/common/timer.h"
#include "acmp_mapping/map/map_mesh.h"
#include "acmp_mapping/map/map_store.h"
#include "acmp_mapping/map/map_writer.h"
#include "acmp_mapping/map/occupancy_map.h"
#include "acmp_mapping/mesh/distance_volume.h"
#include "acmp_mapping/ros/output_conversion.h"
#include "acmp_mapping/ros/session_bag.h"
#include "tool_main.h"

namespace {

constexpr double kWidthM = 4, kHeightM = 3, kDistanceM = 4;  ///< what a keyframe sees of the wall

const acmp::PinholeCamera kCamera = {640, 480, 640, 640, 0, 0};  ///< sees that of it; with the images of a session

struct MapBenchmarkArguments {
  int keyframes = 500;
  int points = 100000;
  double overlap = 0.5;
  double voxel_size_m = 0.01;
  std::filesystem::path folder = std::filesystem::temp_directory_path();
};

void AddOptions(CLI::App* app, MapBenchmarkArguments* a) {
  app->add_option("--keyframes", a->keyframes, "Keyframes of the map")
      ->check(CLI::Range(2, 100000))
      ->capture_default_str();
  app->add_option("--points", a->points, "Points of a keyframe")
      ->check(CLI::Range(100, 10000000))
      ->capture_default_str();
  app->add_option("--overlap", a->overlap, "Share of a keyframe that the next one sees, too")
      ->check(CLI::Range(0.0, 0.99))
      ->capture_default_str();
  app->add_option("--voxel-size", a->voxel_size_m, "Metres")->check(CLI::Range(1e-4, 1.0))->capture_default_str();
  app->add_option("--folder", a->folder, "Where map files are written, and removed again")->capture_default_str();
}

acmp::RigidTransform WorldFromCamera(const MapBenchmarkArguments& a, int keyframe) {
  acmp::RigidTransform pose = acmp::RigidTransform::Identity();
  pose.translation().x() = keyframe * (1 - a.overlap) * kWidthM;
  pose.rotate(Eigen::AngleAxisd(0.1 * std::sin(keyframe), Eigen::Vector3d::UnitY()));
  return pose;
}

/// A wavy wall before the camera, sampled at a grid's points. All but the positions is noisy, for files are compressed.
acmp::PointCloud MakePoints(const MapBenchmarkArguments& a, const acmp::RigidTransform& world_from_cam) {
  const acmp::RigidTransform cam_from_world = world_from_cam.inverse();
  const int columns = static_cast<int>(std::sqrt(a.points * kWidthM / kHeightM));
  const int rows = a.points / columns;
  std::minstd_rand random;
  std::uniform_real_distribution<float> noise(-0.2f, 0.2f);
  acmp::PointCloud points;
  points.reserve(static_cast<size_t>(columns) * static_cast<size_t>(rows));
  for (int row = 0; row < rows; ++row) {
    for (int col = 0; col < columns; ++col) {
      const double x = world_from_cam.translation().x() + (col + 0.5) * kWidthM / columns;
      const double y = (row + 0.5) * kHeightM / rows;
      const Eigen::Vector3d point = cam_from_world * Eigen::Vector3d(x, y, kDistanceM + 0.1 * std::sin(3 * x + 2 * y));
      const auto grey = static_cast<unsigned char>(128 + 100 * noise(random));
      const Eigen::Vector3f normal = Eigen::Vector3f(noise(random), noise(random), -1).normalized();
      points.push_back({{static_cast<float>(point.x()), static_cast<float>(point.y()), static_cast<float>(point.z())},
                        {normal.x(), normal.y(), normal.z()},
                        {grey, grey, grey},
                        0.75f + noise(random)});
    }
  }
  return points;
}

/// A line "Name: 123 kB" of /proc/self/status, in GB; 0 where the system does not tell.
double MemoryGb(const std::string& name) {
  std::ifstream status("/proc/self/status");
  for (std::string line; std::getline(status, line);) {
    if (line.rfind(name + ":", 0) == 0) return std::stod(line.substr(name.size() + 1)) * 1024e-9;
  }
  return 0;
}

/// Runs a step and prints its line of the table.
template <class Step>
void Measure(const std::string& name, const Step& step) {
  std::ofstream("/proc/self/clear_refs") << 5;  // the peak starts from here
  acmp::Timer timer;
  const std::string result = step();
  std::cout << std::left << std::setw(28) << name << std::right << std::fixed << std::setprecision(4) << std::setw(10)
            << timer.Lap() * 1e-3 << std::setprecision(2) << std::setw(10) << MemoryGb("VmHWM") << std::setw(10)
            << MemoryGb("VmRSS") << "  " << result << std::endl;
}

int RunBenchmark(const MapBenchmarkArguments& a) {
  std::cout << "step                                 s   peak GB    now GB\n";
  acmp::MapStore store({a.keyframes, a.voxel_size_m, 0});
  std::vector<acmp::StampedPose> path;
  double adding_s = 0;
  Measure("make and add keyframes", [&] {
    for (int i = 0; i < a.keyframes; ++i) {
      path.push_back({i * int64_t{1000000000}, WorldFromCamera(a, i)});
      const acmp::PointCloud points = MakePoints(a, path.back().pose);
      acmp::Timer timer;
      const acmp::KeyframePose pose = {path.back().stamp_ns, path.back().pose, {}, "", "camera", kCamera};
      store.Add({"mapper", 0, static_cast<uint64_t>(i)}, pose, points);
      adding_s += timer.Lap() * 1e-3;
    }
    return acmp::Concat(store.statistics().points, " points, of these adding: ", adding_s * 1e3 / a.keyframes,
                        " ms per keyframe");
  });
  for (acmp::StampedPose& pose : path) pose.pose.translation().y() += 1e-3 * pose.pose(0, 3);
  Measure("re-pose all keyframes", [&] { return acmp::Concat(store.Repose(path).moved.size(), " keyframes moved"); });
  Measure("the same path again", [&] { return acmp::Concat(store.Repose(path).moved.size(), " keyframes moved"); });
  acmp::MapCloud map;
  Measure("build the map", [&] {
    map = store.WorldCloud();
    return acmp::Concat(map.points.size(), " points");
  });
  map = {};
  Measure("build it, re-pose meanwhile", [&] {
    std::future<acmp::MapCloud> building = std::async(std::launch::async, [&store] { return store.WorldCloud(); });
    int corrections = 0;
    double longest_ms = 0;
    while (building.wait_for(std::chrono::milliseconds(100)) != std::future_status::ready) {
      for (acmp::StampedPose& pose : path) pose.pose.translation().z() += 0.1;
      acmp::Timer timer;
      store.Repose(path);
      longest_ms = std::max(longest_ms, timer.Lap());
      ++corrections;
    }
    map = building.get();
    return acmp::Concat(corrections, " corrections, the longest took ", longest_ms, " ms");
  });
  Measure("make the message",
          [&] { return acmp::Concat(acmp::ToCloudMessage(map.points, std_msgs::Header())->data.size(), " bytes"); });
  if (acmp::CanMesh()) {
    Measure("build the mesh", [&] {
      const double bound_gb = acmp::DefaultMemoryLimitGb();
      const acmp::TriangleMesh mesh = acmp::MakeMapMesh(store, {0, static_cast<size_t>(1e9 * bound_gb)}).mesh;
      return acmp::Concat(mesh.triangles.size(), " triangles");
    });
  }
  if (acmp::CanMapOccupancy()) {
    Measure("build the occupancy",
            [&] { return acmp::Concat(acmp::MakeOccupancyMap(store.Placed(), 0)->nodes(), " nodes of the octree"); });
  }
  for (const auto& [name, format] : {std::pair("map.ply", acmp::MapFormat::kPly), {"map.pcd", acmp::MapFormat::kPcd}}) {
    const std::filesystem::path file = a.folder / acmp::Concat("acmp_map_benchmark_", ::getpid(), "_", name);
    Measure(acmp::Concat("write ", name), [&, format = format] {
      acmp::WriteMap(file, map, format, true);
      return acmp::Concat(std::filesystem::file_size(file), " bytes");
    });
    std::filesystem::remove(file);
  }
  map = {};
  const std::filesystem::path file = a.folder / acmp::Concat("acmp_map_benchmark_", ::getpid(), ".bag");
  Measure("save the session", [&] {
    acmp::WriteSession(file, {store.Session(), "map"});
    return acmp::Concat(std::filesystem::file_size(file), " bytes");
  });
  Measure("load it into an empty map", [&] {
    acmp::MapStore loaded({a.keyframes, a.voxel_size_m, 0});
    loaded.Join(acmp::ReadSession(file).map, acmp::RigidTransform::Identity());
    return acmp::Concat(loaded.statistics().points, " points");
  });
  std::filesystem::remove(file);
  return acmp::Printed();
}

}  // namespace

// NOLINTNEXTLINE(bugprone-exception-escape): only a wrong table of options or no memory throw outside RunTool
int main(int argc, char** argv) {
  CLI::App app(
      "Measures time and memory of a large map: adding keyframes, re-posing them, building, publishing, saving.",
      "acmp_map_benchmark");
  app.footer("Exit code: 0 done, 2 wrong use or input, 1 failed.");
  MapBenchmarkArguments arguments;
  AddOptions(&app, &arguments);
  return acmp::RunTool(app, argc, argv, [&] { return RunBenchmark(arguments); });
}
