#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "acmp_mapping/common/memory_limit.h"
#include "acmp_mapping/mapping/dense_mapper.h"
#include "acmp_mapping/pose_refinement/pose_refinement_options.h"

namespace acmp {

/// What `acmp_reconstruct` is asked to do. Defaults are shown by --help.
struct ReconstructOptions {
  std::filesystem::path scene;
  std::filesystem::path output;
  std::string format = "auto";
  std::string pixel_centers = "integer";
  std::filesystem::path image_path;   ///< folder of the images; empty: images/ of the scene
  std::string images;                 ///< "0,3,7-12"; empty: all
  std::string wide_faces = "auto";    ///< SplitWideImages, or "off"
  double field_of_view = 0;           ///< of lenses with distortion, Lens's; deg
  std::filesystem::path masks;        ///< folder (AddMasks); empty: none
  std::filesystem::path prior_depth;  ///< folder (AddPriorDepths); empty: none

  std::string preset = "balanced";
  std::string schedule = "offline";
  std::vector<std::string> set;  ///< NAME=VALUE: options of the pipeline over the preset's
  int max_image_size = 0;        ///< px, longer side; 0: as stored
  int source_views = 10;         ///< 1..32
  int min_source_views = 0;      ///< 0: 1 offline, the mapper's default online
  double depth_min = 0;          ///< scene units; 0: the dataset's or the landmarks'
  double depth_max = 0;
  uint32_t seed = PatchMatchOptions().seed;
  PoseRefinementOptions pose_refinement = {RefinePoses::kOff, 500};
  DenseMapperOptions mapper;  ///< online: window_size, lookahead and refine_again; MakeMapperOptions sets the others

  std::string device = "auto";
  std::vector<int> cuda_index = {0};
  int jobs_per_gpu = 4;
  int threads = 0;  ///< 0: one per core
  double memory_limit_gb = DefaultMemoryLimitGb();

  std::filesystem::path plan;  ///< file to write: only plan the stages; empty: do everything
  bool stages = false;         ///< do only those that ReconstructStages is told
  int chunk_images = 16;       ///< scene indices that a planned task has

  std::vector<std::string> maps = {"depth", "normal", "cost", "confidence"};  ///< kinds to write; none: only the cloud
  std::filesystem::path mesh;  ///< file to write, .ply or .obj; empty: no mesh
  double mesh_voxel_size = 0;  ///< scene units; 0: DefaultVoxelSize
  bool dmb = false;
  bool colmap = false;
  bool no_pictures = false;
  bool overwrite = false;
  bool keep_work = false;
  bool quiet = false;

  bool online() const { return schedule == "online"; }

  /// Of memory_limit_gb, what each kind may take: images; what rectifies images; estimates or maps; points that
  /// wait for those of earlier images.
  static constexpr double kImageShare = 0.4, kRectifierShare = 0.05, kMapShare = 0.4, kPointShare = 0.1;
  /// @param share 0..1
  size_t MemoryBytes(double share) const { return static_cast<size_t>(share * 1e9 * memory_limit_gb); }
};

/// All options of the command line that are one value, by their names there: "--preset".
OptionList OptionsOf(ReconstructOptions* options);

/// Throws InvalidInputError naming the first option out of bounds.
void Validate(const ReconstructOptions& options);

/// Throws InvalidInputError for a preset that cannot use prior depth.
void CheckPriorDepthIsUsed(const ReconstructOptions& options);

PipelineOptions MakePipelineOptions(const ReconstructOptions& options);

/// For the online schedule. `dataset_range` stands in where an image has no landmarks; 0, 0 when the dataset names
/// none.
DenseMapperOptions MakeMapperOptions(const ReconstructOptions& options, const DepthRange& dataset_range);

/// Source views an image needs to get a map.
int MinSourceViews(const ReconstructOptions& options);

}  // namespace acmp
