#pragma once

#include <filesystem>
#include <functional>
#include <string>

#include <acmp_mapping/KeyframePoints.h>

#include "acmp_mapping/common/memory_limit.h"
#include "acmp_mapping/map/map_store.h"

/// A map in a bag, see docs/map.md; no master is needed.
namespace acmp {

struct Session {
  MapSession map;
  std::string world_frame;
};

using KeepImage = std::function<StoredImagePtr(const acmp_mapping::KeyframePoints&)>;

/// Of the bags that WriteSession writes, under session_version in each. To be raised with any change of their messages.
constexpr uint32_t kSessionVersion = 3;

/// Writes the keyframes as keyframe_points, and depth, confidence and colour as images, which are made of the points.
/// The file appears under its name only when it is whole and on the disk. Throws InvalidInputError for an empty map or
/// a path that cannot be one, ProcessingError with the system's reason when writing fails.
/// @param check called before each keyframe; what it throws ends the work
void WriteSession(
    const std::filesystem::path& path, const Session& session, const std::function<void()>& check = [] {});

/// Throws InvalidInputError that names the file and says what to do when it is missing, cut off, damaged, no session or
/// one of another version, or would take more than max_bytes: a part of the file when it is unpacked, or the images of
/// a keyframe when it is saved again.
/// @param keep_image called with each keyframe, as StoreImage; empty: images are left out
Session ReadSession(const std::filesystem::path& path, size_t max_bytes = kMemoryLimitBytes,
                    const KeepImage& keep_image = {});

}  // namespace acmp
