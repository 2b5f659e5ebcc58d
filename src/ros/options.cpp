#include "acmp_mapping/ros/options.h"

#include <algorithm>
#include <cstdlib>
#include <filesystem>
#include <functional>
#include <sstream>
#include <vector>

#include <dynamic_reconfigure/config_tools.h>

#include "acmp_mapping/common/error.h"
#include "acmp_mapping/dataset/output_file.h"
#include "acmp_mapping/keyframe/frame.h"
#include "acmp_mapping/mapping/dense_mapper.h"
#include "acmp_mapping/ros/input_conversion.h"

namespace acmp {
namespace {

using dynamic_reconfigure::ConfigTools;
using XmlRpc::XmlRpcValue;
using Child = PoseSemantics::Child;

constexpr int kMaxCudaDevice = 63;
constexpr char kPoseUnit[] = "(unit of the poses)";

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

/// Each row by row, one after the other.
std::vector<RigidTransform> ParseTransforms(const char* name, const std::vector<double>& numbers) {
  constexpr size_t kSize = 16;
  if (numbers.size() % kSize != 0) {
    throw InvalidInputError(
        Concat(name, " has ", numbers.size(), " numbers: must have 16, a 4x4 matrix row by row, for each camera"));
  }
  std::vector<RigidTransform> transforms;
  for (auto m = numbers.begin(); m != numbers.end(); m += kSize) {
    if (m[12] != 0 || m[13] != 0 || m[14] != 0 || m[15] != 1) {
      throw InvalidInputError(
          Concat(name, ": the last row is ", m[12], " ", m[13], " ", m[14], " ", m[15], ", must be 0 0 0 1"));
    }
    RigidTransform transform = RigidTransform::Identity();
    transform.matrix() = Eigen::Map<const Eigen::Matrix<double, 4, 4, Eigen::RowMajor>>(&*m);
    CheckPose(name, transform);
    transforms.push_back(transform);
  }
  return transforms;
}

/// The one; empty: none.
std::optional<RigidTransform> ParseTransform(const char* name, const std::vector<double>& numbers) {
  const std::vector<RigidTransform> transforms = ParseTransforms(name, numbers);
  if (transforms.size() > 1) {
    throw InvalidInputError(Concat(name, " has ", numbers.size(), " numbers: must have 16, a 4x4 matrix row by row"));
  }
  return transforms.empty() ? std::nullopt : std::make_optional(transforms[0]);
}

std::vector<double> NumbersOf(const std::vector<RigidTransform>& transforms) {
  std::vector<double> numbers;
  for (const RigidTransform& transform : transforms) {
    const Eigen::Matrix<double, 4, 4, Eigen::RowMajor> rows = transform.matrix();
    numbers.insert(numbers.end(), rows.data(), rows.data() + rows.size());
  }
  return numbers;
}

[[noreturn]] void Refuse(const std::string& name, const XmlRpcValue& value, const char* expected) {
  std::ostringstream text;
  text.imbue(std::locale::classic());
  value.write(text);
  throw InvalidInputError(Concat("parameter ~", name, " = ", text.str(), ": must be ", expected));
}

bool ToDouble(XmlRpcValue& value, double* number) {
  if (value.getType() == XmlRpcValue::TypeInt) {
    *number = static_cast<int&>(value);
    return true;
  }
  if (value.getType() != XmlRpcValue::TypeDouble) return false;
  *number = static_cast<double&>(value);
  return true;
}

bool AppendNumbers(XmlRpcValue& value, std::vector<double>* numbers) {
  double number = 0;
  if (ToDouble(value, &number)) {
    numbers->push_back(number);
    return true;
  }
  if (value.getType() != XmlRpcValue::TypeArray) return false;
  for (int i = 0; i < value.size(); ++i) {
    if (!AppendNumbers(value[i], numbers)) return false;
  }
  return true;
}

OptionValue Convert(const std::string& name, XmlRpcValue& value, const OptionValue& like) {
  const XmlRpcValue::Type type = value.getType();
  if (std::holds_alternative<bool>(like)) {
    if (type != XmlRpcValue::TypeBoolean) Refuse(name, value, "true or false");
    return static_cast<bool>(static_cast<bool&>(value));
  }
  if (std::holds_alternative<int>(like)) {
    if (type != XmlRpcValue::TypeInt) Refuse(name, value, "an integer");
    return static_cast<int>(static_cast<int&>(value));
  }
  if (std::holds_alternative<double>(like)) {
    double number = 0;
    if (!ToDouble(value, &number)) Refuse(name, value, "a number");
    return number;
  }
  if (std::holds_alternative<std::string>(like)) {
    if (type != XmlRpcValue::TypeString) Refuse(name, value, "a text");
    return static_cast<std::string>(static_cast<std::string&>(value));
  }
  std::vector<double> numbers;
  if (type != XmlRpcValue::TypeArray || !AppendNumbers(value, &numbers)) Refuse(name, value, "a list of numbers");
  return numbers;
}

/// Those of the pipeline, auto and none. A preset of several scales needs the maps of all images at each of them.
std::vector<std::string> OnlinePresets() {
  std::vector<std::string> names;
  for (const std::string& name : PresetNames()) {
    if (!MakePreset(name).multi_scale) names.push_back(name);
  }
  names.emplace_back(kAutoPreset);
  names.emplace_back();
  return names;
}

}  // namespace

void ParameterReader::Read(const OptionList& options) {
  for (const Option& option : options) {
    known_.insert(option.name);
    if (values_.getType() != XmlRpcValue::TypeStruct || !values_.hasMember(option.name)) continue;
    const OptionValue value = Convert(option.name, values_[option.name], option.get());
    CheckOption(option, value, "parameter ~");
    option.set(value);
  }
}

std::vector<std::string> ParameterReader::DescribeUnknown() const {
  std::vector<std::string> sentences;
  if (values_.getType() != XmlRpcValue::TypeStruct) return sentences;
  XmlRpcValue values = values_;  // iteration is not const
  for (auto& member : values) {
    const std::string& name = member.first;
    if (known_.count(name) > 0 || member.second.getType() == XmlRpcValue::TypeStruct) continue;
    const auto elsewhere = elsewhere_.find(name);
    if (elsewhere != elsewhere_.end()) {
      sentences.push_back(Concat("parameter ~", name, " has no effect here: it is one of ", elsewhere->second));
      continue;
    }
    const std::optional<std::string> similar = MostSimilar(name, {known_.begin(), known_.end()});
    sentences.push_back(Concat("unknown parameter ~", name, " has no effect: ",
                               similar ? "did you mean ~" + *similar + "?" : "none has a name like that"));
  }
  return sentences;
}

// The tables. yaml, .cfg and docs/parameters.md are written from them (acmp_options).

OptionList OptionsOf(NodeOptions* o) {
  using Direction = PoseSemantics::Direction;
  OptionList list;
  list.Group("device and preset");
  list.Add(
      "device", "auto (a GPU if there is a usable one), cuda, cuda:1 (the second GPU) or cpu",
      [o] { return OptionValue(DeviceName(*o)); },
      [o](const OptionValue& value) { SetDevice(std::get<std::string>(value), o); });
  list.Text("preset", &o->preset,
            "How depth is computed: start values of the options of the pipeline; auto: the best of balanced, online "
            "and online with smaller images that the machine keeps up with, up to max_image_size and max_source_views; "
            "empty: balanced, or auto where there is no GPU and overload is not block")
      .choices = OnlinePresets();
  list.Number("max_image_size", &o->max_image_size, 0, 100000, "px",
              "Images are shrunk until their longer side has so many pixels; time grows with its square; 0: as sent");

  list.Group("camera");
  list.Choice("image_transport", &o->image_transport, {"raw", "compressed"},
              "Images come on the topic image, or as JPEG or PNG on image/compressed");
  list.Flag("rectified", &o->rectified, "Images are undistorted already, and P of camera_info describes them");
  list.Text("calibration_file", &o->calibration_file,
            "File of camera_calibration (.yaml or .ini) in place of camera_info; empty: camera_info is used");
  list.Choice(
      "wide_faces", &o->wide_faces, {"auto", "off"},
      "auto: an image of more than 120 degrees becomes several pinhole images, which are mapped each; off: one, "
      "without what lies outside of it");
  list.Number("field_of_view", &o->field_of_view, 0, 360, "deg",
              "From side to side, of a lens whose image ends at a circle: what lies outside is masked; 0: the whole "
              "image is seen");
  list.Text("mask_file", &o->mask_file,
            "Picture (.png) of the size of the images as sent: what is black there, such as the robot itself, is "
            "ignored in all of them; empty: nothing is");
  list.Text(
      "label_file", &o->label_file,
      "Names and colours of the classes of the topic labels (.yaml, as config/labels.yaml), and which of them are "
      "ignored as by a mask; empty: all numbers are classes");
  list.Text("camera_frame", &o->camera_frame, "In place of the frame_id of the images; empty: as sent");

  list.Group("poses");
  const std::vector<std::string> children = {Name(Child::kCameraOptical), Name(Child::kCameraFlu), Name(Child::kBody)};
  Option& pose_source = list.Text("pose_source", &o->pose_source,
                                  "Topic of the poses, which tells their type; tf: looked up there, in world_frame");
  for (const PoseInput& topic : PoseInputs()) pose_source.choices.push_back(topic.name);
  pose_source.choices.emplace_back(kTfPoses);
  list.Choice("pose_is", &o->pose.direction, {Name(Direction::kWorldFromCam), Name(Direction::kCamFromWorld)},
              "T_world_cam: the position is the camera's in the world; T_cam_world: the inverse");
  list.Choice("pose_child", &o->pose.child, children,
              "Whose pose it is: the camera's with x right, y down, z forward, or with x forward, y left, z up, or "
              "that of another body, see T_body_cam");
  list.Choice("path_child", &o->path_child, children, "As pose_child, of the topic optimized_path; empty: the same");
  list.Add(
      "T_body_cam",
      "For pose_child body: 4x4 matrix, row by row, from the camera's optical frame to the body; empty: taken from tf, "
      "else from the topic extrinsic",
      [o] {
        const auto& transform = o->pose.body_from_cam;
        return OptionValue(transform ? NumbersOf({*transform}) : std::vector<double>());
      },
      [o](const OptionValue& value) {
        o->pose.body_from_cam = ParseTransform("parameter ~T_body_cam", std::get<std::vector<double>>(value));
      });
  list.Flag("extrinsic_inverted", &o->extrinsic_inverted,
            "The topic extrinsic has T_cam_body, the inverse of T_body_cam");
  list.Text("world_frame", &o->world_frame, "In place of the frame_id of the poses; empty: as sent");
  list.Text("body_frame", &o->body_frame,
            "In place of the child frame of the poses, where tf is asked; empty: as sent");

  list.Group("source cameras");
  list.Number("source_cameras", &o->matcher.source_cameras, 0, kMaxSourceCameras, "",
              "Cameras that are fixed to this one, such as the right one of a stereo pair; their images, on the topics "
              "source_image, source_image_2 and so on, are source views: also the first keyframe and a camera that "
              "stands have depth, and what moves is matched in its instant");
  list.Add(
      "T_cam_source",
      "Where they are: for each a 4x4 matrix, row by row, from its optical frame to the camera's, in the unit of the "
      "poses; empty: taken from P of the camera_infos, else from tf",
      [o] { return OptionValue(NumbersOf(o->cam_from_sources)); },
      [o](const OptionValue& value) {
        o->cam_from_sources = ParseTransforms("parameter ~T_cam_source", std::get<std::vector<double>>(value));
      });
  list.Text("source_calibration_file", &o->source_calibration_file,
            "As calibration_file, of each source camera, separated by commas; empty: source_camera_info, "
            "source_camera_info_2 and so on are used");
  list.Number("source_tolerance", &o->matcher.source_tolerance_s, 0, 0.1, "s",
              "An image and those of the source cameras that were taken with it differ by no more than this in their "
              "stamps; one that has not come after mask_wait is done without");

  list.Group("sparse points, masks and stamps");
  list.Choice("sparse_frame", &o->sparse_frame, {"auto", "world", "camera"},
              "Frame of the sparse points; auto: told by their frame_id");
  list.Number(
      "sync_tolerance", &o->matcher.sync_tolerance_s, 0, 10, "s",
      "An image and its pose differ by no more than this in their stamps; where the poses before and after are both "
      "so near, its own is between them");
  list.Number("sparse_wait", &o->matcher.sparse_wait_s, 0, 10, "s",
              "An image with a pose waits so long for the sparse points of its stamp");
  list.Number("mask_wait", &o->matcher.mask_wait_s, 0, 10, "s",
              "An image with a pose waits so long for its mask, prior depth, labels and images of source cameras, "
              "while somebody publishes these topics; then it is used as a whole, or goes without");

  list.Group("keyframes");
  list.Choice("keyframe_mode", &o->keyframe_mode, {"every_pose", "gate", "external"},
              "Keyframes are all images with a pose, those of them that show something new, or what the topic keyframe "
              "brings");
  list.Choice("overload", &o->overload, {"drop", "skip_if_busy", "block"},
              "When keyframes come faster than they are mapped: groups of neighbours are mapped, or only what comes "
              "while the mapper is idle, and others are matched against the rest; or, for recordings, all images wait "
              "their turn, as long as they fit in a quarter of the memory: what comes beyond is dropped and told");
  list.Number(
      "keep_images", &o->keep_images, 0, 100000, "px",
      "Undistorted images of keyframes go to the map with their points, for COLMAP models (save_map): JPEG files "
      "whose longer side has so many pixels at most; 0: none");
  list.Number("memory_limit", &o->memory_limit_gb, 0.01, 1000, "GB",
              "What an image may take while it is decoded and undistorted: a camera_info of more pixels is refused "
              "before memory is asked for");
  return list;
}

OptionList OptionsOf(RuntimeOptions* o) {
  OptionList list;
  list.Group("keyframes");
  list.Number("gate_baseline_ratio", &o->gate.min_baseline_ratio, 0, 10, "",
              "keyframe_mode gate: a keyframe is so far from the last, and from others of the window with the same "
              "view, as a share of the scene's median depth")
      .WhileRunning();
  list.Append(OptionsOf(&o->mapper));
  list.Group("output");
  list.Number("min_depth_confidence", &o->min_depth_confidence, 0, 1, "",
              "Refined depth of less confidence is not published; 0: all is")
      .WhileRunning();
  list.Append(OptionsOf(&o->mapper.pipeline), true);
  return list;
}

OptionList OptionsOf(MapServerOptions* o) {
  OptionList list;
  list.Group("map");
  list.Number("max_keyframes", &o->map.max_keyframes, 1, 1000000, "",
              "Keyframes kept in the map, of all mappers together; the oldest go first");
  list.Number("map_radius", &o->map.map_radius, 0, 1e9, kPoseUnit,
              "Keyframes farther than this from the newest one of every mapper leave the map; 0: no limit");
  list.Number("voxel_size", &o->map.voxel_size, 0, 1e6, kPoseUnit,
              "The map has one point per cube of this size; 0: 0.5 % of the first keyframe's median depth");
  list.Choice("on_time_jump", &o->map.forget_earlier_runs, {"keep", "reset"},
              "When a mapper's images go back in time, as in a bag that is played again, it was restarted, or its "
              "frontend went on in another world: keep its earlier keyframes, or forget them");
  list.Number("map_publish_rate", &o->map_publish_rate, 0, 30, "Hz",
              "The map is published at most so often; 0: only when the service publish_map is called");
  list.Number("occupancy_min_height", &o->occupancy_min_height, -1e6, 1e6, kPoseUnit,
              "The topic occupancy tells what is between two heights (z of the world frame, which must be upwards): "
              "this is the lower one, above the floor");
  list.Number("occupancy_max_height", &o->occupancy_max_height, -1e6, 1e6, kPoseUnit,
              "The upper one: the height of the robot");
  list.Flag("z_up", &o->z_up,
            "z of the world points up from a floor at 0. If false, occupancy is empty where cameras are not upright in "
            "a world whose z points up, as is that of most frontends of one camera");
  list.Flag(
      "distance_to_unknown", &o->distance_to_unknown,
      "Distances (distance_slice, get_distances) are those to the nearest obstacle or unknown space, whichever is "
      "nearer; if false, to the nearest obstacle");
  list.Number("mesh_rate", &o->mesh_rate, 0, 30, "Hz",
              "What has changed of the mesh is published at most so often, to who listens; 0: there is no mesh");
  list.Number("mesh_time", &o->mesh_time, 0.001, 10, "s",
              "What may be computed for a message; what takes longer goes on with the next ones");
  list.Number("mesh_memory", &o->mesh_memory_gb, 0.01, 1000, "GB",
              "What the mesh's voxels may take, while somebody listens: they get larger where they would need more");
  list.Number("memory_limit", &o->memory_limit_gb, 0.01, 1000, "GB",
              "What one keyframe or session may take while it is saved, loaded or published: more is refused before "
              "memory is asked for, and occupancy gets larger cells");
  list.Text("label_file", &o->label_file,
            "As that of the mapper: colours of the classes, and which of them are no obstacles");
  list.Text("save_folder", &o->save_folder,
            "Maps and sessions are saved and loaded only below this folder, where relative paths start; empty: "
            "~/.ros/acmp_mapping (in ROS_HOME where that is set), which is made; /: anywhere");
  list.Text("load_session", &o->load_session,
            "Session (save_session) to begin with, in place of an empty map; empty: none");
  return list;
}

namespace {

void Check(const NodeOptions& options) {
  const bool body = options.pose.child == Child::kBody;
  if (options.pose.body_from_cam && !body && PathChild(options) != Child::kBody) {
    throw InvalidInputError("parameter ~T_body_cam is set: needs ~pose_child = body");
  }
  const size_t num_placed = options.cam_from_sources.size();
  if (num_placed != 0 && num_placed != static_cast<size_t>(options.matcher.source_cameras)) {
    throw InvalidInputError(
        Concat("parameter ~T_cam_source has ", num_placed,
               " matrices: must have one for each of ~source_cameras = ", options.matcher.source_cameras));
  }
  if (options.pose_source != kTfPoses) return;
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

/// What follows from the options that a user sets.
void SetDependentOptions(RuntimeOptions* options) {
  DenseMapperOptions* mapper = &options->mapper;
  options->gate.remembered = static_cast<size_t>(std::max(mapper->window_size, 1));
  // A keyframe needs two useful views, or as many as it can have.
  mapper->min_source_views =
      std::min({DenseMapperOptions().min_source_views, mapper->max_source_views, std::max(mapper->window_size - 1, 1)});
}

/// A configuration of value(option) for each option that may change.
DenseMapperConfig MakeConfig(RuntimeOptions options, const std::function<OptionValue(const Option&)>& value) {
  dynamic_reconfigure::Config message;
  for (const Option& option : OptionsOf(&options)) {
    if (!option.while_running) continue;
    const OptionValue of_option = value(option);
    if (const bool* flag = std::get_if<bool>(&of_option)) ConfigTools::appendParameter(message, option.name, *flag);
    if (const int* integer = std::get_if<int>(&of_option)) ConfigTools::appendParameter(message, option.name, *integer);
    if (const double* number = std::get_if<double>(&of_option))
      ConfigTools::appendParameter(message, option.name, *number);
  }
  DenseMapperConfig config = DenseMapperConfig::__getDefault__();
  config.__fromMessage__(message);
  return config;
}

/// One end of the bounds, as the kind of value that the option has.
OptionValue BoundOf(const Option& option, bool upper) {
  const double bound = upper ? option.max : option.min;
  const OptionValue like = option.get();
  if (std::holds_alternative<bool>(like)) return upper;
  if (std::holds_alternative<int>(like)) return static_cast<int>(bound);
  return bound;
}

/// Not the folder that the node was started in, which may be the home: whoever reaches the ROS master may save there.
std::string MakeDefaultFolder() {
  const char* ros_home = std::getenv("ROS_HOME");
  const char* home = std::getenv("HOME");
  if (!ros_home && !home) {
    throw InvalidInputError("parameter ~save_folder is empty, and neither HOME nor ROS_HOME is set: must be a folder");
  }
  const auto folder =
      (ros_home ? std::filesystem::path(ros_home) : std::filesystem::path(home) / ".ros") / "acmp_mapping";
  MakeFolder(folder);
  return folder.string();
}

}  // namespace

bool NeedsExtrinsic(const NodeOptions& options) {
  const bool body = options.pose.child == Child::kBody || PathChild(options) == Child::kBody;
  return body && !options.pose.body_from_cam;
}

PoseSemantics::Child PathChild(const NodeOptions& options) { return options.path_child.value_or(options.pose.child); }

NodeOptions LoadNodeOptions(ParameterReader* reader) {
  NodeOptions options;
  reader->Read(OptionsOf(&options));
  for (std::string* frame : {&options.world_frame, &options.camera_frame, &options.body_frame}) {
    *frame = StripLeadingSlash(*frame);
  }
  Check(options);
  return options;
}

std::string UsedPreset(const NodeOptions& options, bool on_cpu) {
  if (!options.preset.empty()) return options.preset;
  return on_cpu && options.overload != OverloadPolicy::kBlock ? kAutoPreset : kUsualPreset;
}

RuntimeOptions LoadRuntimeOptions(ParameterReader* reader, const RuntimeOptions& start) {
  RuntimeOptions options = start;
  reader->Read(OptionsOf(&options));
  SetDependentOptions(&options);
  Validate(options.mapper);
  const DepthRange& range = options.mapper.fallback_depth_range;
  if (HasDepthRange(range) != (range.min > 0 || range.max > 0)) {
    throw InvalidInputError(Concat("~depth_min = ", range.min, " and ~depth_max = ", range.max, ": set both or none"));
  }
  return options;
}

RuntimeOptions LoadRuntimeOptions(ParameterReader* reader, const AutoPreset::Setting& setting) {
  RuntimeOptions start;
  start.mapper.pipeline = MakePreset(setting.preset);
  RuntimeOptions options = LoadRuntimeOptions(reader, start);
  int* max_source_views = &options.mapper.max_source_views;
  *max_source_views = std::min(*max_source_views, setting.max_source_views);
  SetDependentOptions(&options);
  return options;
}

DenseMapperConfig ToConfig(const RuntimeOptions& options) {
  return MakeConfig(options, [](const Option& option) { return option.get(); });
}

RuntimeOptions FromConfig(const DenseMapperConfig& config, const RuntimeOptions& current) {
  dynamic_reconfigure::Config message;
  config.__toMessage__(message);
  RuntimeOptions options = current;
  for (const Option& option : OptionsOf(&options)) {
    if (!option.while_running) continue;
    OptionValue value = option.get();
    if (bool* flag = std::get_if<bool>(&value)) ConfigTools::getParameter(message, option.name, *flag);
    if (int* integer = std::get_if<int>(&value)) ConfigTools::getParameter(message, option.name, *integer);
    if (double* number = std::get_if<double>(&value)) ConfigTools::getParameter(message, option.name, *number);
    CheckOption(option, value);
    option.set(value);
  }
  SetDependentOptions(&options);
  Validate(options.mapper);
  return options;
}

std::pair<DenseMapperConfig, DenseMapperConfig> ConfigBounds() {
  return {MakeConfig({}, [](const Option& option) { return BoundOf(option, false); }),
          MakeConfig({}, [](const Option& option) { return BoundOf(option, true); })};
}

MapServerOptions LoadMapServerOptions(ParameterReader* reader) {
  MapServerOptions options;
  reader->Read(OptionsOf(&options));
  if (!(options.occupancy_min_height < options.occupancy_max_height)) {
    throw InvalidInputError(Concat("parameter ~occupancy_min_height = ", options.occupancy_min_height,
                                   ": must be below ~occupancy_max_height = ", options.occupancy_max_height));
  }
  if (options.save_folder.empty()) options.save_folder = MakeDefaultFolder();
  if (!std::filesystem::is_directory(options.save_folder)) {
    const bool is_there = std::filesystem::exists(options.save_folder);
    throw InvalidInputError(
        Concat("parameter ~save_folder = \"", options.save_folder,
               "\": ", is_there ? "is no folder" : "there is no such folder: make it (mkdir -p)",
               options.save_folder.front() == '~' ? "; ~ is not replaced here: give the whole path" : ""));
  }
  constexpr double kDiskForImages = 0.5;  // of what is free, as maps, sessions and others need some
  std::error_code ignored;                // where it is not known, writing an image says when there is none
  const std::filesystem::space_info space = std::filesystem::space(options.save_folder, ignored);
  if (!ignored)
    options.map.max_image_bytes = static_cast<uint64_t>(kDiskForImages * static_cast<double>(space.available));
  return options;
}

}  // namespace acmp
