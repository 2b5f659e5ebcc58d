#pragma once

#include <cstdint>
#include <filesystem>
#include <memory>
#include <string>
#include <string_view>

#include "acmp_mapping/geometry/pinhole_camera.h"

namespace acmp {

/// The content of an image file on the disk, as long as this lives.
class StoredImage {
 public:
  ~StoredImage();
  StoredImage(const StoredImage&) = delete;
  StoredImage& operator=(const StoredImage&) = delete;

  /// Throws ProcessingError with the system's reason when it cannot be read.
  std::string Read() const;
  uint64_t bytes() const { return bytes_; }
  const PinholeCamera& camera() const { return camera_; }

 private:
  friend class ImageStore;
  struct File;
  StoredImage(std::shared_ptr<File> file, uint64_t place, uint64_t bytes, const PinholeCamera& camera);

  std::shared_ptr<File> file_;  ///< where `bytes` at `place` are this image's
  uint64_t place_, bytes_;
  PinholeCamera camera_;
};
using StoredImagePtr = std::shared_ptr<const StoredImage>;

/// Undistorted images of keyframes, on the disk so that memory is the map's: in one file without a name, which is gone
/// with the process however it ends. What images leave is used again by later ones. Thread-safe; images may outlive it.
class ImageStore {
 public:
  /// @param folder where the file is made with the first image
  explicit ImageStore(const std::filesystem::path& folder);

  /// @param jpeg content of a JPEG file, of the same view as the camera's at any size
  /// @param camera of the keyframe's maps; the stored image's is the same at the image's size
  /// Throws InvalidInputError for what is no JPEG file, or of another shape than the camera's image, ProcessingError
  /// with the system's reason when it cannot be written.
  StoredImagePtr Put(std::string_view jpeg, const PinholeCamera& camera);

 private:
  const std::shared_ptr<StoredImage::File> file_;
};

}  // namespace acmp
