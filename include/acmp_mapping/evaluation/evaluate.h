#pragma once

#include <filesystem>
#include <set>
#include <string>
#include <vector>

#include "acmp_mapping/dataset/map_io.h"
#include "acmp_mapping/evaluation/cloud_metrics.h"
#include "acmp_mapping/evaluation/depth_metrics.h"

namespace acmp {

/// Where the true depth maps of a scene are and how they are stored: .png, .pfm or .dmb, named as the predictions.
struct GroundTruthOptions {
  std::string folder = "depth";  ///< in the scene, or anywhere
  double png_unit = 1000.0;      ///< counts of .png files per scene unit, > 0
  double max_depth = 0;          ///< what is beyond is left out; 0: none
};

struct DepthEvaluationOptions {
  std::filesystem::path scene;
  std::filesystem::path predictions;
  GroundTruthOptions truth;
  double scale = 1.0;              ///< predictions are multiplied by it, > 0
  bool median_scale = false;       ///< then each by its own MedianScale
  double low_texture = 4.0;        ///< grey levels; 0 turns the row off
  std::set<int> subset;            ///< image indices; empty: all
  std::vector<std::string> masks;  ///< folders of 8-bit pictures, each a row of its own
};

struct ImageEvaluation {
  int index = 0;
  std::string name;
  bool has_prediction = false;
  DepthMetrics metrics;
};

/// Mean over the images in which a region has more than 50 ground-truth pixels.
struct RegionEvaluation {
  std::string name;
  double share = 0;  ///< mean share of ground-truth pixels in the region, 0..1
  DepthMetrics mean;
};

struct DepthEvaluation {
  std::vector<ImageEvaluation> images;  ///< those with ground truth
  DepthMetrics mean;
  DepthMetrics pool;                      ///< all pixels of all images together
  std::vector<RegionEvaluation> regions;  ///< "lowtex", then the masks, as far as they occur
  std::vector<std::string> notes;
};

/// Compares the depth maps of a folder with a scene's ground truth. A map is IMAGE.EXT, by the image's name, else
/// 000007.EXT or 00000007.EXT by its index, of .pfm, .dmb and .png in this order. Throws InvalidInputError for whatever
/// is missing, unreadable or out of bounds, and where no image has a map.
DepthEvaluation EvaluateDepthFolder(const DepthEvaluationOptions& options);

/// 1 where the 11x11 neighbourhood in the picture, resized to width x height, has a standard deviation below
/// `threshold`.
Image<unsigned char> LowTextureMask(GrayImage picture, int width, int height, double threshold);

struct CloudEvaluationOptions {
  std::filesystem::path reconstruction;  ///< what ReadCloud reads
  std::filesystem::path ground_truth;    ///< the same, or a scene: folder with cameras.txt and true depth maps
  GroundTruthOptions truth;              ///< of a scene
  std::vector<double> thresholds = {0.02, 0.05};
  double voxel_size = 0.01;
};

/// The points of a PLY file, or of its surface where it is a mesh. Throws InvalidInputError as ReadPly and
/// SampleMesh do.
/// @param mesh_spacing of the points on a mesh
/// @param origin see ReadPly
PointCloud ReadCloud(const std::filesystem::path& path, double mesh_spacing, ReadOrigin* origin = nullptr);

struct CloudEvaluation {
  size_t reconstructed_points = 0;
  size_t observed_points = 0;  ///< of the reconstructed ones, those that count for accuracy; all against a file
  size_t true_points = 0;
  size_t true_maps = 0;  ///< 0 against a file
  double voxel_size = 0;
  std::vector<CloudMetrics> metrics;
};

/// Compares a cloud with the truth. A scene's true maps become an ObservedSurface with points half a voxel apart and
/// the largest threshold as tolerance: points of the reconstruction that no map observes do not count for accuracy. A
/// map of another size than its camera in cameras.txt is taken as the whole image at that size. Throws
/// InvalidInputError for whatever is missing, unreadable or out of bounds.
CloudEvaluation EvaluateCloudFile(const CloudEvaluationOptions& options);

/// One line per image (unless `quiet`), then mean, pool and regions.
std::string DepthTable(const DepthEvaluation& evaluation, bool quiet);

/// Everything of the table; null where a figure is undefined.
std::string DepthJson(const DepthEvaluation& evaluation);

/// A line on the two clouds, then one line per threshold.
std::string CloudTable(const CloudEvaluation& evaluation);

/// Everything of the table; "true_maps" is 0 where the ground truth was a cloud.
std::string CloudJson(const CloudEvaluation& evaluation);

}  // namespace acmp
