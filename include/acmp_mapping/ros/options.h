#pragma once

#include <map>
#include <mutex>
#include <optional>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include <XmlRpcValue.h>
#include <acmp_mapping/DenseMapperConfig.h>

#include "acmp_mapping/backend/make_depth_engine.h"
#include "acmp_mapping/common/memory_limit.h"
#include "acmp_mapping/common/option.h"
#include "acmp_mapping/intake/input_matcher.h"
#include "acmp_mapping/intake/keyframe_gate.h"
#include "acmp_mapping/intake/pose_semantics.h"
#include "acmp_mapping/map/live_mesh.h"
#include "acmp_mapping/map/map_store.h"
#include "acmp_mapping/mapping/auto_preset.h"
#include "acmp_mapping/mapping/dense_mapper.h"
#include "acmp_mapping/ros/pose_sources.h"
#include "acmp_mapping/ros/work_queue.h"

namespace acmp {

using acmp_mapping::DenseMapperConfig;

/// Reads the parameters of one private namespace and remembers which names exist, so that a mistyped one is noticed.
class ParameterReader {
 public:
  /// @param values the namespace as a struct (NodeHandle::getParam("", ...)); anything else counts as empty
  explicit ParameterReader(const XmlRpc::XmlRpcValue& values) : values_(values) {}

  /// Sets those of the options whose parameters are set. Integers are accepted for floating-point numbers, not the
  /// other way round; lists of lists of numbers are strung together row by row. Throws InvalidInputError naming
  /// parameter and value for one of another kind, and for one out of bounds.
  void Read(const OptionList& options);

  /// Names that somebody else reads.
  void Allow(const std::string& name) { known_.insert(name); }

  /// A name that another node reads from its own namespace.
  void SetElsewhere(const std::string& name, const std::string& node) { elsewhere_[name] = node; }

  /// A sentence for each name that nobody asked for, with the most similar one that exists. Sub-namespaces are left
  /// alone: plugins of image_transport keep their own parameters in some.
  std::vector<std::string> DescribeUnknown() const;

 private:
  XmlRpc::XmlRpcValue values_;
  std::set<std::string> known_;
  std::map<std::string, std::string> elsewhere_;  ///< node of each name
};

constexpr char kAutoPreset[] = "auto";  ///< value of `preset`: AutoPreset
constexpr char kUsualPreset[] = "balanced";

enum class ImageTransport { kRaw, kCompressed };
enum class WideFaces { kAuto, kOff };
enum class SparseFrame { kAuto, kWorld, kCamera };
enum class KeyframeMode {
  kEveryPose,
  kGate,
  kExternal,  ///< the frontend's own keyframes, on the topic `keyframe` alone
};

/// What the mapper reads once when it is loaded; OptionsOf says what each means and what it may be, here and below.
struct NodeOptions {
  Device device = Device::kAuto;
  int cuda_device = 0;  ///< 0-based
  std::string preset;   ///< empty = UsedPreset chooses
  ImageTransport image_transport = ImageTransport::kRaw;
  bool rectified = false;
  int max_image_size = 640;  ///< px, longer side; 0 = as sent
  std::string calibration_file;
  WideFaces wide_faces = WideFaces::kAuto;
  double field_of_view = 0;                      ///< deg, as Lens takes it
  std::string mask_file;                         ///< of the image as sent; empty = none
  std::string label_file;                        ///< as LabelTable reads it; empty = none
  std::vector<RigidTransform> cam_from_sources;  ///< of each source camera; empty = told by camera_info or tf
  std::string source_calibration_file;           ///< of each source camera, separated by commas; empty = camera_info
  std::string pose_source = std::get<0>(kPoseSources).name;  ///< or kTfPoses
  PoseSemantics pose;
  std::optional<PoseSemantics::Child> path_child;  ///< of optimized_path; none = as the poses
  bool extrinsic_inverted = false;                 ///< the topic `extrinsic` has T_cam_body
  std::string world_frame;                         ///< empty = as sent, as the next two
  std::string camera_frame;
  std::string body_frame;
  SparseFrame sparse_frame = SparseFrame::kAuto;
  InputMatcherOptions matcher;
  KeyframeMode keyframe_mode = KeyframeMode::kEveryPose;
  OverloadPolicy overload = OverloadPolicy::kDrop;
  int keep_images = 0;                      ///< px, longer side of images that go to the map; 0 = none
  double memory_limit_gb = kMemoryLimitGb;  ///< of a message while it is worked on
};
OptionList OptionsOf(NodeOptions* options);

/// Throws InvalidInputError naming the parameter and what it may be.
NodeOptions LoadNodeOptions(ParameterReader* reader);

/// `preset`; where that is empty kAutoPreset for a CPU that has to keep up with its input, else kUsualPreset.
std::string UsedPreset(const NodeOptions& options, bool on_cpu);

/// Whether T_body_cam is needed and not a parameter: then it is looked up in tf and awaited on the topic extrinsic.
bool NeedsExtrinsic(const NodeOptions& options);

/// Whose poses optimized_path has.
PoseSemantics::Child PathChild(const NodeOptions& options);

/// What decides the maps. Some of it may change while the nodelet runs (dynamic_reconfigure): the worker takes one copy
/// per keyframe.
struct RuntimeOptions {
  DenseMapperOptions mapper;
  KeyframeGateOptions gate;
  double min_depth_confidence = 0;
};
/// Gate, window, output, and of the pipeline what may change while it runs.
OptionList OptionsOf(RuntimeOptions* options);

/// Parameters of the namespace over the defaults in `start`. Throws InvalidInputError for a value that is out of bounds
/// or does not fit another one.
RuntimeOptions LoadRuntimeOptions(ParameterReader* reader, const RuntimeOptions& start);

/// The same over the preset of a setting, whose source views limit those of the namespace.
RuntimeOptions LoadRuntimeOptions(ParameterReader* reader, const AutoPreset::Setting& setting);

DenseMapperConfig ToConfig(const RuntimeOptions& options);

/// `current` with what may change taken from the configuration. Throws InvalidInputError as LoadRuntimeOptions does.
RuntimeOptions FromConfig(const DenseMapperConfig& config, const RuntimeOptions& current);

/// Least and largest values. They are not in the .cfg file, since the server of dynamic_reconfigure would silently
/// limit values to them before FromConfig sees these.
std::pair<DenseMapperConfig, DenseMapperConfig> ConfigBounds();

/// The runtime options, set by dynamic_reconfigure and copied by the threads that use them. Thread-safe.
class SharedOptions {
 public:
  explicit SharedOptions(const RuntimeOptions& options) : options_(options) {}

  void Set(const RuntimeOptions& options) {
    std::lock_guard<std::mutex> lock(mutex_);
    options_ = options;
  }

  RuntimeOptions Get() const {
    std::lock_guard<std::mutex> lock(mutex_);
    return options_;
  }

 private:
  mutable std::mutex mutex_;
  RuntimeOptions options_;
};

constexpr size_t kMeshTriangles = 50000;  ///< of a message, 120 bytes each

/// What the map server reads once when it is loaded. What poses mean comes with the keyframes.
struct MapServerOptions {
  MapStoreOptions map;
  double map_publish_rate = 0.5;      ///< Hz
  double occupancy_min_height = 0.1;  ///< of the topic occupancy: z in the world
  double occupancy_max_height = 1;
  bool z_up = false;                        ///< z of the world is known to point up, whatever ZPointsUp says
  bool distance_to_unknown = false;         ///< unknown space is an obstacle to distances
  double mesh_rate = 10;                    ///< Hz
  double mesh_time = 0.1;                   ///< s, of an update
  double mesh_memory_gb = 0.25;             ///< of its voxels
  double memory_limit_gb = kMemoryLimitGb;  ///< of a message or a file while it is worked on
  std::string label_file;                   ///< as LabelTable reads it; empty: none
  std::string save_folder;                  ///< save_map and sessions: only below it; never empty once loaded
  std::string load_session;                 ///< loaded at start; empty: none

  size_t memory_limit_bytes() const { return static_cast<size_t>(memory_limit_gb * 1e9); }
  LiveMeshOptions mesh() const { return {static_cast<size_t>(mesh_memory_gb * 1e9), kMeshTriangles, mesh_time}; }
};
OptionList OptionsOf(MapServerOptions* options);

/// Throws InvalidInputError naming the parameter and what it may be.
MapServerOptions LoadMapServerOptions(ParameterReader* reader);

}  // namespace acmp
