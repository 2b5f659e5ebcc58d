// What a plan's file and the hash of a run's input say of images: in CBOR, as names of images need not be UTF-8.

#include <tbb/parallel_for.h>

#include <algorithm>
#include <nlohmann/json.hpp>

#include "acmp_mapping/common/classic_locale.h"
#include "acmp_mapping/common/error.h"
#include "acmp_mapping/common/stop_request.h"
#include "plan.h"
#include "work_files.h"

namespace acmp {
namespace {

using Json = nlohmann::ordered_json;

/// Below the root relative to it, so that machines may have it at different places.
std::string RelativePath(const std::filesystem::path& path, const std::filesystem::path& root) {
  const std::filesystem::path relative = path.lexically_relative(root);
  return relative.empty() || *relative.begin() == ".." ? path.string() : relative.string();
}

// Values of the plan's file: Put writes one, Take reads it.

template <class T>
Json Put(const T& value) {
  return value;
}
template <class T>
void Take(const Json& json, T* value) {
  *value = json.get<T>();
}
template <int rows, int cols>
Json Put(const Eigen::Matrix<double, rows, cols>& matrix) {
  return std::vector<double>(matrix.data(), matrix.data() + matrix.size());
}
template <int rows, int cols>
void Take(const Json& json, Eigen::Matrix<double, rows, cols>* matrix) {
  const auto numbers = json.get<std::vector<double>>();
  if (numbers.size() != static_cast<size_t>(matrix->size())) throw ProcessingError("the plan's file has another form");
  std::copy(numbers.begin(), numbers.end(), matrix->data());
}
Json Put(const PinholeCamera& c) { return {c.width, c.height, c.fx, c.fy, c.cx, c.cy}; }
void Take(const Json& json, PinholeCamera* camera) {
  *camera = {json.at(0), json.at(1), json.at(2), json.at(3), json.at(4), json.at(5)};
}
Json Put(const std::optional<FaceOfImage>& face) {
  return face ? Json{Put(face->file_camera), Put(face->lens_from_face)} : Json();
}
void Take(const Json& json, std::optional<FaceOfImage>* face) {
  if (json.is_null()) return;
  Take(json.at(0), &face->emplace().file_camera);
  Take(json.at(1), &(*face)->lens_from_face);
}

/// visit(name, value) for what the files of a scene say of an image, but for its landmarks and what the plan has in
/// their place.
template <class Image, class Visit>
void VisitImage(Image* image, const Visit& visit) {
  visit("name", &image->name);
  visit("camera", &image->camera);
  visit("distortion", &image->distortion.model);
  visit("coefficients", &image->distortion.coefficients);
  visit("field_of_view", &image->field_of_view);
  visit("face", &image->face);
  visit("turn", &image->readout.turn);
  visit("move", &image->readout.move);
  visit("pose", &image->cam_from_world.matrix());
  visit("placed", &image->placed_from_world.matrix());
}

template <class Plan, class Visit>
void VisitPlan(Plan* plan, const Visit& visit) {
  visit("index", &plan->index);
  visit("near", &plan->range.min);
  visit("far", &plan->range.max);
  visit("sources", &plan->sources);
  visit("no_map", &plan->no_map);
}

}  // namespace

std::vector<std::string> HashFiles(const Scene& scene, const std::vector<int>& indices, const StopRequest& interrupt,
                                   const std::function<void(int index)>& also) {
  std::vector<std::string> hashes(indices.size());
  tbb::parallel_for(size_t{0}, indices.size(), [&](size_t i) {
    interrupt.Check();
    also(indices[i]);
    const SceneImage& image = scene.images[static_cast<size_t>(indices[i])];
    hashes[i] = ChecksumsOf({image.path, image.mask, image.prior_depth});
  });
  interrupt.Check();
  return hashes;
}

int FindChangedImage(const Scene& scene, const std::vector<int>& indices, const std::vector<std::string>& files,
                     const StopRequest& interrupt) {
  const std::vector<std::string> now = HashFiles(scene, indices, interrupt, [](int) {});
  const auto changed = std::mismatch(now.begin(), now.end(), files.begin()).first - now.begin();
  return changed == static_cast<ptrdiff_t>(now.size()) ? -1 : indices[static_cast<size_t>(changed)];
}

std::string InputHash(const Scene& scene, const std::vector<int>& indices, const std::vector<std::string>& files) {
  uint32_t hash = 0;
  for (size_t i = 0; i < indices.size(); ++i) {
    const SceneImage& image = scene.images[static_cast<size_t>(indices[i])];
    const DepthRange range = image.depth_range.value_or(DepthRange());
    Json input = {indices[i], files.at(i), range.min, range.max, image.ranked_sources};
    VisitImage(&image, [&](const char*, const auto* value) { input.push_back(Put(*value)); });
    const std::vector<uint8_t> bytes = Json::to_cbor(input);
    hash = AddToChecksum(hash, bytes.data(), bytes.size());
    for (const Eigen::Vector3d& landmark : LandmarksOf(scene, image)) {
      hash = AddToChecksum(hash, landmark.data(), sizeof(landmark));
    }
  }
  return StringPrintf("%08x", hash);
}

std::string FormatPlan(const Scene& scene, const ReconstructPlan& plan, const std::vector<std::string>& files,
                       const std::filesystem::path& root) {
  Json json = {{"origin", Put(plan.origin)}, {"images", Json::array()}};
  for (size_t i = 0; i < plan.images.size(); ++i) {
    const SceneImage& image = scene.images[static_cast<size_t>(plan.images[i].index)];
    Json view = {{"files", files[i]}};
    const auto put = [&](const char* name, const auto* value) { view[name] = Put(*value); };
    VisitImage(&image, put);
    VisitPlan(&plan.images[i], put);
    view["paths"] = {RelativePath(image.path, root), image.mask.string(), image.prior_depth.string()};
    json["images"].push_back(std::move(view));
  }
  const std::vector<uint8_t> bytes = Json::to_cbor(json);
  return {bytes.begin(), bytes.end()};
}

void ParsePlan(const std::string& content, const std::filesystem::path& root, Scene* scene, ReconstructPlan* plan,
               std::map<int, std::string>* files) {
  const Json json = Json::from_cbor(content);
  Take(json.at("origin"), &plan->origin);
  for (const Json& view : json.at("images")) {
    SceneImage image;
    const auto take = [&](const char* name, auto* value) { Take(view.at(name), value); };
    VisitImage(&image, take);
    VisitPlan(&plan->images.emplace_back(), take);
    const Json& paths = view.at("paths");
    image.path = root / paths.at(0).get<std::string>();
    image.mask = paths.at(1).get<std::string>();
    image.prior_depth = paths.at(2).get<std::string>();
    const int index = plan->images.back().index;
    (*files)[index] = view.at("files");
    scene->images.resize(static_cast<size_t>(index) + 1);
    scene->images.back() = std::move(image);
  }
}

}  // namespace acmp
