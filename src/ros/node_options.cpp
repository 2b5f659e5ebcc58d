#include "acmp_mapping/ros/node_options.h"

#include "acmp_mapping/common/error.h"
#include "acmp_mapping/keyframe/frame.h"
#include "acmp_mapping/ros/input_conversion.h"

namespace acmp {
namespace {

constexpr int kMaxCudaDevice = 63;

std::string DeviceName(const NodeOptions& options) {
  if (options.device == Device::kCuda) return options.cuda_device == 0 ? "cuda" : Concat("cuda:", options.cuda_device);
  return options.device == Device::kCpu ? "cpu" : "auto";
}

void SetDevice(const std::string& name, NodeOptions* options) {
  options->cuda_device = 0;
  for (const auto& [known, device] :
       {std::pair("auto", Device::kAuto), {"cuda", Device::kCuda}, {"cpu", Device::kCpu}}) {
    if (name != known) continue;
    options->device = device;
    return;
  }
  for (int index = 0; index <= kMaxCudaDevice; ++index) {
    if (name != Concat("cuda:", index)) continue;
    options->device = Device::kCuda;
    options->cuda_device = index;
    return;
  }
  throw InvalidInputError(Concat("parameter ~device = \"", name, "\": must be auto, cuda, cuda:N with N in [0, ",
                                 kMaxCudaDevice, "], or cpu"));
}

/// Row by row; empty: none.
std::optional<RigidTransform> ParseTransform(const std::vector<double>& m) {
  if (m.empty()) return std::nullopt;
  constexpr char kName[] = "parameter ~T_body_cam";
  if (m.size() != 16) {
    throw InvalidInputError(Concat(kName, " has ", m.size(), " numbers: must have 16, a 4x4 matrix row by row"));
  }
  if (m[12] != 0 || m[13] != 0 || m[14] != 0 || m[15] != 1) {
    throw InvalidInputError(
        Concat(kName, ": the last row is ", m[12], " ", m[13], " ", m[14], " ", m[15], ", must be 0 0 0 1"));
  }
  RigidTransform transform = RigidTransform::Identity();
  transform.matrix() = Eigen::Map<const Eigen::Matrix<double, 4, 4, Eigen::RowMajor>>(m.data());
  CheckPose(kName, transform);
  return transform;
}

std::vector<double> ToNumbers(const std::optional<RigidTransform>& transform) {
  if (!transform) return {};
  const Eigen::Matrix<double, 4, 4, Eigen::RowMajor> rows = transform->matrix();
  return {rows.data(), rows.data() + rows.size()};
}

/// Those of the pipeline and auto. A preset of several scales needs the maps of all images at each of them.
std::vector<std::string> OnlinePresets() {
  std::vector<std::string> names;
  for (const std::string& name : PresetNames()) {
    if (!MakePreset(name).multi_scale) names.push_back(name);
  }
  names.emplace_back(kAutoPreset);
  return names;
}

void AddDeviceAndPreset(OptionTable<NodeOptions>* table) {
  table->Group("device and preset");
  table->Add(
      Text("device", "auto (a GPU if there is a usable one), cuda, cuda:1 (the second GPU) or cpu"),
      [](const NodeOptions& o) { return OptionValue(DeviceName(o)); },
      [](const OptionValue& value, NodeOptions* o) { SetDevice(std::get<std::string>(value), o); });
  table->Add(
      Choice(
          "preset", OnlinePresets(),
          "How depth is computed: start values of the options of the pipeline; auto: the best of balanced, online and "
          "online with smaller images that the machine keeps up with, up to max_image_size and max_source_views"),
      [](auto& o) -> auto& { return o.preset; });
  table->Add(
      Number("max_image_size", 0, 100000, "px",
             "Images are shrunk until their longer side has so many pixels; time grows with its square; 0: as sent"),
      [](auto& o) -> auto& { return o.max_image_size; });
}

void AddCamera(OptionTable<NodeOptions>* table) {
  table->Group("camera");
  table->Add(
      Choice("image_transport", {"raw", "compressed"},
             "Images come on the topic image, or as JPEG or PNG on image/compressed"),
      [](auto& o) -> auto& { return o.image_transport; });
  table->Add(
      Flag("rectified", "Images are undistorted already, and P of camera_info describes them"),
      [](auto& o) -> auto& { return o.rectified; });
  table->Add(
      Text("calibration_file",
           "File of camera_calibration (.yaml or .ini) in place of camera_info; empty: camera_info is used"),
      [](auto& o) -> auto& { return o.calibration_file; });
  table->Add(
      Text(
          "mask_file",
          "Picture (.png) of the size of the images as sent: what is black there, such as the robot itself, is ignored "
          "in all of them; empty: nothing is"),
      [](auto& o) -> auto& { return o.mask_file; });
  table->Add(
      Text("camera_frame", "In place of the frame_id of the images; empty: as sent"),
      [](auto& o) -> auto& { return o.camera_frame; });
}

void AddPoses(OptionTable<NodeOptions>* table) {
  using Direction = PoseSemantics::Direction;
  using Child = PoseSemantics::Child;
  const std::vector<std::string> children = {Name(Child::kCameraOptical), Name(Child::kCameraFlu), Name(Child::kBody)};
  table->Group("poses");
  table->Add(
      Choice("pose_source", {"pose", "pose_cov", "odom", "transform", "tf"},
             "Topic of the poses, which tells their type; tf: looked up there, in world_frame"),
      [](auto& o) -> auto& { return o.pose_source; });
  table->Add(
      Choice("pose_is", {Name(Direction::kWorldFromCam), Name(Direction::kCamFromWorld)},
             "T_world_cam: the position is the camera's in the world; T_cam_world: the inverse"),
      [](auto& o) -> auto& { return o.pose.direction; });
  table->Add(
      Choice("pose_child", children,
             "Whose pose it is: the camera's with x right, y down, z forward, or with x forward, y left, z up, or "
             "that of another body, see T_body_cam"),
      [](auto& o) -> auto& { return o.pose.child; });
  std::vector<std::string> path_children = children;
  path_children.emplace_back();
  table->Add(
      Choice("path_child", path_children, "As pose_child, of the topic optimized_path; empty: the same"),
      [](auto& o) -> auto& { return o.path_child; });
  table->Add(
      Text(
          "T_body_cam",
          "For pose_child body: 4x4 matrix, row by row, from the camera's optical frame to the body; empty: taken from "
          "tf, else from the topic extrinsic"),
      [](const NodeOptions& o) { return OptionValue(ToNumbers(o.pose.body_from_cam)); },
      [](const OptionValue& value, NodeOptions* o) {
        o->pose.body_from_cam = ParseTransform(std::get<std::vector<double>>(value));
      });
  table->Add(
      Flag("extrinsic_inverted", "The topic extrinsic has T_cam_body, the inverse of T_body_cam"),
      [](auto& o) -> auto& { return o.extrinsic_inverted; });
  table->Add(
      Text("world_frame", "In place of the frame_id of the poses; empty: as sent"),
      [](auto& o) -> auto& { return o.world_frame; });
  table->Add(
      Text("body_frame", "In place of the child frame of the poses, where tf is asked; empty: as sent"),
      [](auto& o) -> auto& { return o.body_frame; });
}

void AddInputs(OptionTable<NodeOptions>* table) {
  table->Group("sparse points, masks and stamps");
  table->Add(
      Choice("sparse_frame", {"auto", "world", "camera"}, "Frame of the sparse points; auto: told by their frame_id"),
      [](auto& o) -> auto& { return o.sparse_frame; });
  table->Add(
      Number("sync_tolerance", 0, 10, "s", "An image and its pose differ by no more than this in their stamps"),
      [](auto& o) -> auto& { return o.matcher.sync_tolerance_s; });
  table->Add(
      Number("sparse_wait", 0, 10, "s", "An image with a pose waits so long for the sparse points of its stamp"),
      [](auto& o) -> auto& { return o.matcher.sparse_wait_s; });
  table->Add(
      Number("mask_wait", 0, 10, "s",
             "An image with a pose waits so long for its mask and its prior depth, while somebody publishes the topics "
             "mask "
             "or prior_depth; then it is used as a whole, or goes without"),
      [](auto& o) -> auto& { return o.matcher.mask_wait_s; });

  table->Group("keyframes");
  table->Add(
      Choice("keyframe_mode", {"every_pose", "gate", "external"},
             "Keyframes are all images with a pose, those of them that show something new, or what the topic keyframe "
             "brings"),
      [](auto& o) -> auto& { return o.keyframe_mode; });
  table->Add(
      Choice(
          "overload", {"drop", "skip_if_busy", "block"},
          "When keyframes come faster than they are mapped: groups of neighbours are mapped, or only what comes while "
          "the mapper is idle, and others are matched against the rest; or the input waits, so that nothing of a "
          "recording is lost"),
      [](auto& o) -> auto& { return o.overload; });
  table->Add(
      Number("memory_limit", 0.01, 1000, "GB",
             "What an image may take while it is decoded and undistorted: a camera_info of more pixels is refused "
             "before memory "
             "is asked for"),
      [](auto& o) -> auto& { return o.memory_limit_gb; });
}

void Check(const NodeOptions& options) {
  const bool body = options.pose.child == PoseSemantics::Child::kBody;
  const bool path_of_body = PathSemantics(options).child == PoseSemantics::Child::kBody;
  if (options.pose.body_from_cam && !body && !path_of_body) {
    throw InvalidInputError("parameter ~T_body_cam is set: needs ~pose_child = body");
  }
  if (options.pose_source != PoseSource::kTf) return;
  if (options.world_frame.empty()) {
    throw InvalidInputError("parameter ~pose_source = tf needs ~world_frame, the frame that the map is made in");
  }
  if (body && options.body_frame.empty()) {
    throw InvalidInputError("parameter ~pose_source = tf with ~pose_child = body needs ~body_frame");
  }
  if (options.keyframe_mode == KeyframeMode::kExternal) {
    throw InvalidInputError("parameter ~pose_source = tf: keyframe_mode external brings its own poses");
  }
}

}  // namespace

const OptionTable<NodeOptions>& NodeOptionTable() {
  static const OptionTable<NodeOptions> table = [] {
    OptionTable<NodeOptions> made;
    AddDeviceAndPreset(&made);
    AddCamera(&made);
    AddPoses(&made);
    AddInputs(&made);
    return made;
  }();
  return table;
}

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
  ReadOptions(NodeOptionTable(), reader, &options);
  for (std::string* frame : {&options.world_frame, &options.camera_frame, &options.body_frame}) {
    *frame = StripLeadingSlash(*frame);
  }
  Check(options);
  return options;
}

}  // namespace acmp
