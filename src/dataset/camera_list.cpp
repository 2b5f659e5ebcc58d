#include "acmp_mapping/dataset/map_io.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <limits>
#include <sstream>

#include "acmp_mapping/common/error.h"
#include "acmp_mapping/dataset/output_file.h"
#include "acmp_mapping/geometry/lens.h"
#include "acmp_mapping/geometry/lens_models.h"
#include "input_file.h"

namespace acmp {
namespace {

int ReadSize(TextReader* reader, const char* name) {
  const int64_t pixels = reader->Integer(name);
  return static_cast<int>(
      std::clamp<int64_t>(pixels, -1, std::numeric_limits<int>::max()));  // CheckCamera refuses those
}

RigidTransform ReadPose(TextReader* reader) {
  Eigen::Vector4d q;  // w x y z
  Eigen::Vector3d t;
  for (int i = 0; i < 4; ++i) q[i] = reader->Real("quaternion");
  for (int i = 0; i < 3; ++i) t[i] = reader->Real("position");
  if (!(q.norm() > 0)) reader->Fail("quaternion of length 0: must be above");
  RigidTransform pose = RigidTransform::Identity();
  pose.linear() = Eigen::Quaterniond(q[0], q[1], q[2], q[3]).normalized().toRotationMatrix();
  pose.translation() = t;
  return pose;
}

}  // namespace

void WriteCameraList(const std::filesystem::path& path, const std::vector<ListedCamera>& cameras) {
  constexpr int kDigits = 15;
  std::ostringstream text = MakeTextFile(kDigits);
  text << "# cameras of the images (x right, y down, pixel centres at integer coordinates, no distortion)\n"
          "# columns: index filename fx fy cx cy width height qw qx qy qz tx ty tz\n"
          "# qw..tz is T_world_cam (camera -> world): X_world = R(q) * X_cam + t; camera axes x right, y down, z "
          "forward\n";
  for (const ListedCamera& listed : cameras) {
    const PinholeCamera& c = listed.camera;
    const Eigen::Quaterniond q(listed.world_from_cam.linear());
    const Eigen::Vector3d t = listed.world_from_cam.translation();
    text << listed.image.index << ' ' << listed.image.name << ' ' << c.fx << ' ' << c.fy << ' ' << c.cx << ' ' << c.cy
         << ' ' << c.width << ' ' << c.height << ' ' << q.w() << ' ' << q.x() << ' ' << q.y() << ' ' << q.z() << ' '
         << t.x() << ' ' << t.y() << ' ' << t.z() << '\n';
  }
  WriteFileAtomically(path, text.str());
}

void WriteCalibration(const std::filesystem::path& path, const Lens& lens, const std::string& comment) {
  constexpr int kDigits = 9;
  const PinholeCamera& c = lens.camera();
  const LensModel& model = LensModelOf(lens.distortion().model);
  std::vector<double> coefficients = lens.distortion().coefficients;
  coefficients.resize(model.most);
  std::ostringstream text = MakeTextFile(kDigits);
  const auto add = [&](const char* name, size_t rows, size_t cols, const std::vector<double>& data) {
    text << name << ":\n  rows: " << rows << "\n  cols: " << cols << "\n  data: [";
    for (size_t i = 0; i < data.size(); ++i) text << (i == 0 ? "" : ", ") << data[i];
    text << "]\n";
  };
  text << "# " << comment << "\nimage_width: " << c.width << "\nimage_height: " << c.height
       << "\ncamera_name: camera\n";
  add("camera_matrix", 3, 3, {c.fx, 0, c.cx, 0, c.fy, c.cy, 0, 0, 1});
  text << "distortion_model: " << model.name << '\n';
  add("distortion_coefficients", 1, coefficients.size(), coefficients);
  add("rectification_matrix", 3, 3, {1, 0, 0, 0, 1, 0, 0, 0, 1});
  add("projection_matrix", 3, 4, {c.fx, 0, c.cx, 0, 0, c.fy, c.cy, 0, 0, 0, 1, 0});
  WriteFileAtomically(path, text.str());
}

std::vector<ListedCamera> ReadCameraList(const std::filesystem::path& path) {
  std::vector<ListedCamera> cameras;
  TextReader reader(path);
  while (reader.NextContentLine()) {
    const int64_t index = reader.Integer("image index");
    if (index < 0 || index > std::numeric_limits<int>::max()) {
      reader.Fail(Concat("image index = ", index, ": must be a whole number from 0 on"));
    }
    ListedCamera listed;
    listed.image = {static_cast<int>(index), reader.Word("image name")};
    PinholeCamera& c = listed.camera;
    c.fx = reader.Real("fx");
    c.fy = reader.Real("fy");
    c.cx = reader.Real("cx");
    c.cy = reader.Real("cy");
    c.width = ReadSize(&reader, "width");
    c.height = ReadSize(&reader, "height");
    listed.world_from_cam = ReadPose(&reader);
    CheckCamera(reader.Where().c_str(), c);
    cameras.push_back(listed);
  }
  if (cameras.empty()) throw InvalidInputError(Concat(path.string(), ": names 0 images: must name at least 1"));
  return cameras;
}

}  // namespace acmp
