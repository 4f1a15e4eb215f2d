#pragma once

namespace tether {

struct OrderSettings {
  bool in_order = false;  ///< no packet overtakes another one

  bool operator==(const OrderSettings&) const = default;
};

}  // namespace tether
