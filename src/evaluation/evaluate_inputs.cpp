#include "evaluate_inputs.h"

#include <algorithm>
#include <charconv>
#include <cstdio>
#include <optional>
#include <regex>

#include "acmp_mapping/common/error.h"
#include "acmp_mapping/dataset/image_codec.h"
#include "acmp_mapping/dataset/map_io.h"
#include "acmp_mapping/geometry/voxel.h"

namespace acmp {
namespace {

namespace fs = std::filesystem;

std::optional<int> LastNumber(const std::string& text) {
  static const std::regex pattern("([0-9]+)[^0-9]*$");
  std::smatch number;
  if (!std::regex_search(text, number, pattern)) return {};
  const std::string digits = number[1];
  int value = 0;
  const bool fits = std::from_chars(digits.data(), digits.data() + digits.size(), value).ec == std::errc();
  return fits ? std::make_optional(value) : std::nullopt;
}

std::vector<fs::path> SortedEntries(const fs::path& folder) {
  std::vector<fs::path> entries;
  for (const fs::directory_entry& entry : fs::directory_iterator(folder)) {
    if (entry.path().filename().string().front() != '.') entries.push_back(entry.path());
  }
  std::sort(entries.begin(), entries.end());
  return entries;
}

// The output of the public ACMP program.
std::map<int, fs::path> FindAcmpOutput(const std::vector<fs::path>& entries, const std::string& name) {
  const std::vector<std::string> candidates =
      name.empty() ? std::vector<std::string>{"depths_geom.dmb", "depths_prior.dmb", "depths.dmb"}
                   : std::vector<std::string>{name};
  std::map<int, fs::path> found;
  for (const fs::path& folder : entries) {
    const auto index = LastNumber(folder.filename().string());
    for (const std::string& candidate : candidates) {
      if (!index || !fs::exists(folder / candidate)) continue;
      found[*index] = folder / candidate;
      break;
    }
  }
  return found;
}

std::regex ParsePattern(const std::string& text) {
  try {
    return std::regex(text);
  } catch (const std::regex_error& error) {
    throw InvalidInputError(Concat("--name \"", text, "\": not a regular expression: ", error.what()));
  }
}

// Files of an extension: an image's own stem goes before its index, which the first file in order gets.
std::map<int, fs::path> FindNamedMaps(const std::vector<fs::path>& entries, const std::vector<ListedImage>& images,
                                      const std::regex& pattern, const char* extension) {
  std::map<std::string, int> index_of_stem;
  for (const ListedImage& image : images) {
    index_of_stem[fs::path(image.name).replace_extension().string()] = image.index;
  }
  std::map<int, fs::path> found;
  for (const fs::path& file : entries) {
    if (LowerExtension(file) != extension || !std::regex_search(file.filename().string(), pattern)) continue;
    const std::string stem = file.stem().string();
    if (const auto own = index_of_stem.find(stem); own != index_of_stem.end()) {
      found[own->second] = file;
    } else if (const auto index = LastNumber(stem)) {
      found.emplace(*index, file);
    }
  }
  return found;
}

}  // namespace

PredictionIndex FindPredictions(const fs::path& folder, const std::vector<ListedImage>& images,
                                const std::string& name) {
  if (!fs::is_directory(folder)) throw InvalidInputError(Concat(folder.string(), ": no such folder of predictions"));
  const std::vector<fs::path> entries = SortedEntries(folder);
  std::vector<fs::path> acmp_folders;
  for (const fs::path& entry : entries) {
    if (entry.filename().string().rfind("2333_", 0) == 0) acmp_folders.push_back(entry);
  }

  PredictionIndex index;
  if (!acmp_folders.empty()) {
    index.files = FindAcmpOutput(acmp_folders, name);
  } else {
    const std::regex pattern = ParsePattern(name);
    index.files = FindNamedMaps(entries, images, pattern, ".pfm");
    size_t set_aside = 0;
    for (const char* extension : {".dmb", ".png"}) {
      for (const auto& [image, path] : FindNamedMaps(entries, images, pattern, extension)) {
        set_aside += !index.files.emplace(image, path).second;
      }
    }
    if (set_aside > 0)
      index.notes.push_back(
          Concat(set_aside, " maps left aside for another of their image: .pfm before .dmb before .png"));
  }
  const bool any = std::any_of(images.begin(), images.end(),
                               [&](const ListedImage& image) { return index.files.count(image.index) > 0; });
  if (!any)
    throw InvalidInputError(Concat(folder.string(), ": no .pfm, .dmb or .png named after an image of the scene"));
  return index;
}

void Validate(const GroundTruthOptions& options) {
  CheckPositive("--gt-png-unit", options.png_unit);
  CheckRange("--max-depth", options.max_depth, 0.0, 1e9);
}

DepthMap ReadGroundTruth(const fs::path& folder, int index, const GroundTruthOptions& options) {
  const fs::path path = FindMap(folder, index, {".png", ".pfm", ".dmb"});
  if (path.empty()) return {};
  DepthMap truth = ReadDepth(path, options.png_unit);
  if (options.max_depth > 0) {
    const auto limit = static_cast<float>(options.max_depth);
    std::replace_if(
        truth.begin(), truth.end(), [limit](float z) { return z > limit; }, 0.0f);
  }
  return truth;
}

fs::path FindFolder(const fs::path& scene, const std::string& name) {
  for (const fs::path& folder : {scene / name, fs::path(name)}) {
    if (fs::is_directory(folder)) return folder;
  }
  throw InvalidInputError(Concat("no folder ", (scene / name).string(), " nor ", name));
}

fs::path FindMap(const fs::path& folder, int index, const std::vector<std::string>& extensions) {
  char stem[16];
  std::snprintf(stem, sizeof(stem), "%06d", index);
  for (const std::string& extension : extensions) {
    fs::path path = folder / (stem + extension);
    if (fs::exists(path)) return path;
  }
  return {};
}

}  // namespace acmp
