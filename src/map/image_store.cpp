#include "acmp_mapping/map/image_store.h"

#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cmath>
#include <cstdlib>
#include <cstring>
#include <map>
#include <mutex>
#include <utility>

#include "acmp_mapping/common/error.h"
#include "acmp_mapping/dataset/image_codec.h"

namespace acmp {
namespace {

[[noreturn]] void FailImages(const std::filesystem::path& folder, const char* what) {
  throw ProcessingError(Concat("cannot ", what, " images of keyframes in ", folder.string(), ": ",
                               errno == 0 ? "the file is too short" : std::strerror(errno)));
}

/// pread or pwrite until all is done; false with errno, 0 at the end of the file.
template <class Function, class Byte>
bool ForAllBytes(const Function& function, int descriptor, Byte* data, uint64_t bytes, uint64_t place) {
  while (bytes > 0) {
    errno = 0;
    const ssize_t done = function(descriptor, data, bytes, static_cast<off_t>(place));
    if (done < 0 && errno == EINTR) continue;
    if (done <= 0) return false;
    data += done, place += static_cast<uint64_t>(done), bytes -= static_cast<uint64_t>(done);
  }
  return true;
}

/// The camera at the size of the image. Sides may have been rounded to whole pixels twice.
PinholeCamera CameraOfImage(const PinholeCamera& camera, std::string_view jpeg) {
  if (jpeg.substr(0, 2) != "\xff\xd8")
    throw InvalidInputError(Concat("image of ", jpeg.size(), " bytes is no JPEG file"));
  const ImageSize size = EncodedImageSize("image", jpeg);
  const double skew = static_cast<double>(size.width) * camera.height - static_cast<double>(size.height) * camera.width;
  const int longest = std::max({size.width, size.height, camera.width, camera.height});
  if (std::abs(skew) <= longest) return camera.Resized(size.width, size.height);
  throw InvalidInputError(Concat("image of ", size.width, " x ", size.height, " px: must have the shape of its maps, ",
                                 camera.width, " x ", camera.height));
}

}  // namespace

struct StoredImage::File {
  explicit File(std::filesystem::path path) : folder(std::move(path)) {}
  ~File() {
    if (descriptor >= 0) close(descriptor);
  }
  File(const File&) = delete;
  File& operator=(const File&) = delete;

  const std::filesystem::path folder;
  std::mutex mutex;                    ///< of what follows
  int descriptor = -1;                 ///< open from the first image on
  std::map<uint64_t, uint64_t> taken;  ///< bytes from each place on
};

StoredImage::StoredImage(std::shared_ptr<File> file, uint64_t place, uint64_t bytes, const PinholeCamera& camera)
    : file_(std::move(file)), place_(place), bytes_(bytes), camera_(camera) {}

StoredImage::~StoredImage() {
  const std::lock_guard<std::mutex> lock(file_->mutex);
  file_->taken.erase(place_);
}

std::string StoredImage::Read() const {
  std::string content(bytes_, '\0');
  if (!ForAllBytes(pread, file_->descriptor, content.data(), bytes_, place_)) FailImages(file_->folder, "read");
  return content;
}

ImageStore::ImageStore(const std::filesystem::path& folder) : file_(std::make_shared<StoredImage::File>(folder)) {}

StoredImagePtr ImageStore::Put(std::string_view jpeg, const PinholeCamera& camera) {
  const PinholeCamera of_image = CameraOfImage(camera, jpeg);
  uint64_t place = 0;
  int descriptor = -1;
  {
    const std::lock_guard<std::mutex> lock(file_->mutex);
    if (file_->descriptor < 0) {
      std::string name = (file_->folder / ".images.XXXXXX").string();
      file_->descriptor = mkstemp(name.data());
      if (file_->descriptor < 0 || unlink(name.c_str()) != 0) FailImages(file_->folder, "keep");
    }
    for (const auto& [begin, bytes] : file_->taken) {
      if (begin - place >= jpeg.size()) break;
      place = begin + bytes;
    }
    file_->taken.emplace(place, jpeg.size());
    descriptor = file_->descriptor;
  }
  StoredImagePtr image(new StoredImage(file_, place, jpeg.size(), of_image));
  if (!ForAllBytes(pwrite, descriptor, jpeg.data(), jpeg.size(), place)) FailImages(file_->folder, "keep");
  return image;
}

}  // namespace acmp
