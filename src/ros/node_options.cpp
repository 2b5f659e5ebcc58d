#include "acmp_mapping/ros/node_options.h"

#include <utility>

#include "acmp_mapping/common/error.h"
#include "acmp_mapping/keyframe/frame.h"
#include "acmp_mapping/ros/input_conversion.h"

namespace acmp {
namespace {

template <class Enum>
using NamedValues = std::vector<std::pair<const char*, Enum>>;

template <class Enum>
void ReadEnum(ParameterReader* reader, const char* name, const NamedValues<Enum>& values, Enum* value) {
  std::string text;
  if (!reader->Read(name, &text)) return;
  std::string known;
  for (const auto& [value_name, named_value] : values) {
    if (text == value_name) {
      *value = named_value;
      return;
    }
    known += Concat(known.empty() ? "" : ", ", value_name);
  }
  throw InvalidInputError(Concat("parameter ~", name, " = \"", text, "\": must be one of ", known));
}

RigidTransform ToTransform(const std::vector<double>& m) {
  if (m.size() != 16) {
    throw InvalidInputError(
        Concat("parameter ~T_body_cam has ", m.size(), " numbers: must have 16, a 4x4 matrix row by row"));
  }
  if (m[12] != 0 || m[13] != 0 || m[14] != 0 || m[15] != 1) {
    throw InvalidInputError(Concat("parameter ~T_body_cam: the last row is ", m[12], " ", m[13], " ", m[14], " ", m[15],
                                   ", must be 0 0 0 1"));
  }
  RigidTransform transform = RigidTransform::Identity();
  transform.matrix() = Eigen::Map<const Eigen::Matrix<double, 4, 4, Eigen::RowMajor>>(m.data());
  CheckPose("parameter ~T_body_cam", transform);
  return transform;
}

void LoadPoseSemantics(ParameterReader* reader, NodeOptions* options) {
  PoseSemantics* pose = &options->pose;
  std::string direction, child, path_child;
  if (reader->Read("path_child", &path_child) && !path_child.empty()) {
    options->path_child = ParsePoseChild("path_child", path_child);
  }
  if (reader->Read("pose_is", &direction)) pose->direction = ParsePoseDirection(direction);
  if (reader->Read("pose_child", &child)) pose->child = ParsePoseChild("pose_child", child);
  std::vector<double> matrix;
  const bool has_matrix = reader->Read("T_body_cam", &matrix) && !matrix.empty();
  const bool body = pose->child == PoseSemantics::Child::kBody || options->path_child == PoseSemantics::Child::kBody;
  if (!body && has_matrix) throw InvalidInputError("parameter ~T_body_cam is set: needs ~pose_child = body");
  if (has_matrix) pose->body_from_cam = ToTransform(matrix);
}

void LoadFrames(ParameterReader* reader, NodeOptions* options) {
  reader->Read("world_frame", &options->world_frame);
  reader->Read("camera_frame", &options->camera_frame);
  reader->Read("body_frame", &options->body_frame);
  for (std::string* frame : {&options->world_frame, &options->camera_frame, &options->body_frame}) {
    *frame = StripLeadingSlash(*frame);
  }
  const bool from_tf = options->pose_source == PoseSource::kTf;
  if (from_tf && options->world_frame.empty()) {
    throw InvalidInputError("parameter ~pose_source = tf needs ~world_frame, the frame that the map is made in");
  }
  if (from_tf && options->pose.child == PoseSemantics::Child::kBody && options->body_frame.empty()) {
    throw InvalidInputError("parameter ~pose_source = tf with ~pose_child = body needs ~body_frame");
  }
  if (from_tf && options->keyframe_mode == KeyframeMode::kExternal) {
    throw InvalidInputError("parameter ~pose_source = tf: keyframe_mode external brings its own poses");
  }
}

}  // namespace

bool NeedsExtrinsic(const NodeOptions& options) {
  const bool body =
      options.pose.child == PoseSemantics::Child::kBody || PathSemantics(options).child == PoseSemantics::Child::kBody;
  return body && !options.pose.body_from_cam;
}

PoseSemantics PathSemantics(const NodeOptions& options) {
  PoseSemantics path = options.pose;
  path.child = options.path_child.value_or(path.child);
  return path;
}

NodeOptions LoadNodeOptions(ParameterReader* reader) {
  NodeOptions options;
  ReadEnum<Device>(reader, "device", {{"auto", Device::kAuto}, {"cuda", Device::kCuda}, {"cpu", Device::kCpu}},
                   &options.device);
  reader->Read("cuda_device", &options.cuda_device);
  CheckRange("parameter ~cuda_device", options.cuda_device, 0, 63);
  reader->Read("preset", &options.preset);
  ReadEnum<ImageTransport>(reader, "image_transport",
                           {{"raw", ImageTransport::kRaw}, {"compressed", ImageTransport::kCompressed}},
                           &options.image_transport);
  reader->Read("rectified", &options.rectified);
  reader->Read("max_image_size", &options.max_image_size);
  CheckRange("parameter ~max_image_size", options.max_image_size, 0, 100000);
  reader->Read("calibration_file", &options.calibration_file);
  ReadEnum<PoseSource>(reader, "pose_source",
                       {{"pose", PoseSource::kPose},
                        {"pose_cov", PoseSource::kPoseWithCovariance},
                        {"odom", PoseSource::kOdometry},
                        {"transform", PoseSource::kTransform},
                        {"tf", PoseSource::kTf}},
                       &options.pose_source);
  LoadPoseSemantics(reader, &options);
  reader->Read("extrinsic_inverted", &options.extrinsic_inverted);
  ReadEnum<SparseFrame>(
      reader, "sparse_frame",
      {{"auto", SparseFrame::kAuto}, {"world", SparseFrame::kWorld}, {"camera", SparseFrame::kCamera}},
      &options.sparse_frame);
  reader->Read("sync_tolerance", &options.matcher.sync_tolerance_s);
  reader->Read("sparse_tolerance", &options.matcher.sparse_tolerance_s);
  reader->Read("sparse_wait", &options.matcher.sparse_wait_s);
  Validate(options.matcher);
  ReadEnum<KeyframeMode>(
      reader, "keyframe_mode",
      {{"every_pose", KeyframeMode::kEveryPose}, {"gate", KeyframeMode::kGate}, {"external", KeyframeMode::kExternal}},
      &options.keyframe_mode);
  LoadFrames(reader, &options);
  ReadEnum<OverloadPolicy>(reader, "overload",
                           {{"drop_oldest", OverloadPolicy::kDropOldest},
                            {"skip_if_busy", OverloadPolicy::kSkipIfBusy},
                            {"block", OverloadPolicy::kBlock}},
                           &options.overload);
  return options;
}

}  // namespace acmp
