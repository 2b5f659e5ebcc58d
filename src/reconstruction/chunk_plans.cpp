#include "chunk_plans.h"

#include <algorithm>
#include <nlohmann/json.hpp>
#include <utility>

#include "acmp_mapping/common/error.h"
#include "input_hash.h"
#include "work_blocks.h"

namespace acmp {
namespace {

using Json = nlohmann::ordered_json;

/// Below the root relative to it, so that machines may have it at different places.
std::string RelativePath(const std::filesystem::path& path, const std::filesystem::path& root) {
  const std::filesystem::path relative = path.lexically_relative(root);
  return relative.empty() || *relative.begin() == ".." ? path.string() : relative.string();
}

Json ToJson(const ChunkPlan::View& view, const std::filesystem::path& root) {
  const SceneImage& image = view.image;
  const PinholeCamera& c = image.camera;
  const double* pose = image.cam_from_world.matrix().data();
  return {{"name", image.name},
          {"path", RelativePath(image.path, root)},
          {"mask", image.mask.string()},
          {"prior_depth", image.prior_depth.string()},
          {"camera", {c.fx, c.fy, c.cx, c.cy}},
          {"size", {c.width, c.height}},
          {"distortion", static_cast<int>(image.distortion.model)},
          {"coefficients", image.distortion.coefficients},
          {"pose", std::vector<double>(pose, pose + 16)},
          {"no_map", view.no_map},
          {"geometry", view.geometry}};
}

ChunkPlan::View ViewOf(const Json& json, const std::filesystem::path& root) {
  ChunkPlan::View view;
  SceneImage& image = view.image;
  image.name = json.at("name").get<std::string>();
  image.path = root / json.at("path").get<std::string>();
  image.mask = json.at("mask").get<std::string>();
  image.prior_depth = json.at("prior_depth").get<std::string>();
  const Json& camera = json.at("camera");
  const Json& size = json.at("size");
  image.camera = {size.at(0), size.at(1), camera.at(0), camera.at(1), camera.at(2), camera.at(3)};
  image.distortion.model = static_cast<LensDistortion::Model>(json.at("distortion").get<int>());
  image.distortion.coefficients = json.at("coefficients").get<std::vector<double>>();
  const std::vector<double> pose = json.at("pose").get<std::vector<double>>();
  std::copy_n(pose.begin(), 16, image.cam_from_world.matrix().data());
  view.no_map = json.at("no_map").get<std::string>();
  view.geometry = json.at("geometry").get<uint64_t>();
  return view;
}

Json ToJson(const ImagePlan& image) {
  return {{"index", image.index}, {"range", {image.range.min, image.range.max}}, {"sources", image.sources}};
}

Json ToJson(const std::map<int, int>& map) {
  Json json = Json::array();
  for (const auto& [key, value] : map) json.push_back({key, value});
  return json;
}

std::string FormatChunk(const Scene& scene, const std::filesystem::path& root, const Eigen::Vector3d& origin,
                        const std::map<int, ChunkPlan::View>& views, const std::vector<const ImagePlan*>& images,
                        const std::map<int, int>& fused_before) {
  Json chunk = {{"images", Json::array()},
                {"views", Json::object()},
                {"origin", {origin.x(), origin.y(), origin.z()}},
                {"fused_before", ToJson(fused_before)}};
  std::set<int> seen;
  for (const ImagePlan* image : images) {
    chunk["images"].push_back(ToJson(*image));
    seen.insert(image->index);
    seen.insert(image->sources.begin(), image->sources.end());
  }
  for (int index : seen) {
    ChunkPlan::View view = views.at(index);
    view.image = scene.images[static_cast<size_t>(index)];
    chunk["views"][std::to_string(index)] = ToJson(view, root);
  }
  return chunk.dump();
}

}  // namespace

std::map<int, std::string> ChunkPlans::Format(const Scene& scene, const std::filesystem::path& scene_root,
                                              const ReconstructPlan& plan, int chunk_images) {
  std::map<int, ChunkPlan::View> views;
  std::map<int, std::vector<const ImagePlan*>> chunks;
  for (const ImagePlan& image : plan.images) {
    ChunkPlan::View& view = views[image.index];
    view.no_map = image.no_map;
    view.geometry = HashOfGeometry(scene, scene.images[static_cast<size_t>(image.index)]);
    chunks[image.index / chunk_images].push_back(&image);
  }
  std::map<int, std::string> files;
  std::map<int, int> last_chunk;  // whose points use pixels of a view, by scene index
  for (const auto& [number, images] : chunks) {
    std::set<int> used;
    for (const ImagePlan* image : images) {
      if (!image->no_map.empty()) continue;
      for (int read : plan.ImagesRead(*image)) used.insert(read);
    }
    std::map<int, int> fused_before;
    for (int index : used) {
      if (const auto last = last_chunk.find(index); last != last_chunk.end()) fused_before.insert(*last);
      last_chunk[index] = number;
    }
    files[number] = FormatChunk(scene, scene_root, plan.origin, views, images, fused_before);
  }
  return files;
}

ChunkPlan ChunkPlans::Read(int chunk) const {
  const std::optional<std::string> content = ReadBlock(FileOf(chunk));
  if (!content) {
    throw InvalidInputError(Concat(output_.string(), ": no plan of the images ", chunk * chunk_images_, "-",
                                   (chunk + 1) * chunk_images_ - 1, ": give --plan first"));
  }
  const Json json = Json::parse(*content);
  ChunkPlan plan;
  for (const auto& [index, view] : json.at("views").items()) plan.views[std::stoi(index)] = ViewOf(view, scene_root_);
  for (const Json& image : json.at("images")) {
    const int index = image.at("index").get<int>();
    plan.images.push_back({index,
                           {image.at("range").at(0).get<float>(), image.at("range").at(1).get<float>()},
                           image.at("sources").get<std::vector<int>>(),
                           plan.views.at(index).no_map});
  }
  for (int axis = 0; axis < 3; ++axis)
    plan.origin[axis] = json.at("origin").at(static_cast<size_t>(axis)).get<double>();
  for (const Json& pair : json.at("fused_before")) plan.fused_before[pair.at(0)] = pair.at(1);
  return plan;
}

std::filesystem::path ChunkPlans::IndexFile() const { return FileOf(0).parent_path() / "chunks.bin"; }

std::vector<int> ChunkPlans::Chunks() const {
  const std::optional<std::string> content = ReadBlock(IndexFile());
  if (!content) throw InvalidInputError(Concat(output_.string(), ": has no plan: give --plan first"));
  return Json::parse(*content).get<std::vector<int>>();
}

void ChunkPlans::Write(const std::map<int, std::string>& files) const {
  std::vector<int> numbers;
  for (const auto& [number, content] : files) {
    numbers.push_back(number);
    if (ReadBlock(FileOf(number)) != content) WriteBlock(FileOf(number), content);
  }
  WriteBlock(IndexFile(), Json(numbers).dump());
}

}  // namespace acmp
