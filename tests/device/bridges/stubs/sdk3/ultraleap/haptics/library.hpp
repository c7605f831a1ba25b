// A stub of the vendor's library, written from the names of its API; not the vendor's.
#pragma once

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "ultraleap/haptics/result.hpp"

#define ULH_SDK_VERSION_MAJOR 3
#define ULH_SDK_VERSION_LONG "3.0.0-stub"

namespace Ultraleap {
namespace Haptics {

enum class DeviceFeatures : std::uint32_t { None = 0, BasicHaptics = 1, StreamingHaptics = 2 };
enum class DeviceClaimStatus : std::uint32_t { None = 0, ThisClient = 1, OtherClient = 2 };

class DeviceInfo {
 public:
  explicit DeviceInfo(std::string identifier);
  const char* getIdentifier() const;
  const char* getModelName() const;
  const char* getFirmwareVersion() const;

 private:
  std::string identifier_, model_, firmware_;
};

class Device {
 public:
  explicit Device(std::string identifier);
  const char* getIdentifier() const;
  result<DeviceInfo> getInfo() const;
  result<DeviceClaimStatus> getClaimStatus() const;

 private:
  std::string identifier_;
};

class Library {
 public:
  Library();
  result<void> connect();
  result<void> connect(const char* path);
  result<Device> findDevice(DeviceFeatures features);
  result<Device> getDevice(const char* identifier);
  result<std::vector<std::string>> getDeviceIdentifiers() const;

 private:
  std::shared_ptr<bool> is_connected_;  // of all copies
};

}  // namespace Haptics
}  // namespace Ultraleap
